"""``activetouch.compare``: play searches with several deciders, and return their comparison."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from activetouch import Scene, TactileSensor
from activetouch.errors import WrongScene
from activetouch.named_scenes import SCENES, NamedScene, as_named
from activetouch.sensor_files import ANY_OBJECT_FILE, NOT_SIMULATED, POLICIES
from belief.constraints import Constraint
from belief.errors import UnknownName
from belief.files import require_writable
from belief.observation_model.embedded_hypotheses import EmbedsByPose
from belief.observation_model.model import GivesLogits
from belief.observation_model.rigid_body import joint_model
from belief.problem import SearchProblem
from belief.references import ForeignCode, build
from belief.table import Table, Tabular
from experiments.command_line.arguments import BadArgument, Count, Jobs, Seed, Trust, check_arguments
from experiments.parallel import ENGINE, default_jobs
from experiments.scene_choice import SceneChoice
from experiments.search.play import (
    FULL_INFORMATION,
    CompositionName,
    FullInformation,
    Searches,
    Setting,
    identity_of,
    prepare,
)
from experiments.search.run import Cell, Run, RunFolder, read_episode
from experiments.search.summary import ALL, Summary
from experiments.search.verdict import answer_sentences, results_table, terminal_table, verdict_sentences
from experiments.sensor_choice import predict_contacts, require_policies
from planners import Decider
from planners.fingerprint import files_digest
from planners.registry import DECIDERS, PREFIX, copyable, find_decider

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from experiments.report import Report
    from planners.certified import Certificate

DEFAULT_DECIDERS = ("information_gain", "point_based", "threshold", "random_confirm")
"""Deciders that are compared by default; the first is the reference."""


@dataclass(frozen=True, eq=False)
class Comparison(Summary, Tabular):
    """A finished comparison, which prints as its table; ``run`` is None if it was computed from episodes alone."""

    run: Run | None = field(default=None, kw_only=True)

    def table(self) -> Table:
        """The table that is printed."""
        return terminal_table(self)

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        """The answer and the table, for a notebook."""
        return "".join(f"<p>{escape(sentence)}</p>" for sentence in self.answer()) + super()._repr_html_()

    def rows(self) -> list[dict[str, Any]]:
        """Results by decider and target, unrounded, and by decider over all targets: ``pandas.DataFrame`` takes them.

        Names: decider, target, episodes, success, success_low, success_high, wrong, none, truncated, unsure, touches,
        touches_median, touches_90, touches_most, return, prob_best.
        """
        return results_table(self).records()

    def to_latex(self) -> str:
        """The table as a LaTeX ``tabular``, with the rules of the package booktabs, without times."""
        return self.table().without(["ms/touch"]).latex()

    def plot(self, axes: Axes, name: str = "success") -> None:
        """Draw a figure on an axis of matplotlib, in its style.

        ``answer``: searches that are right and touches, by decider; ``success``: failures by target; ``frontier``:
        failures against touches.
        """
        from experiments.search.page import FIGURES  # loads matplotlib

        if name not in FIGURES:
            raise UnknownName("figure", name, list(FIGURES))
        FIGURES[name](self, axes)

    @classmethod
    def load(cls, folder: str | Path, *, trust: bool = False) -> Comparison:
        """The latest comparison of a run folder; nothing is played, and no sensor is needed.

        ``trust`` allows code of your own that the folder names, such as a scene ``module:attribute``.
        """
        held = RunFolder(Path(folder))
        stored = held.read_run()
        arguments, seed = stored["arguments"], stored["identity"]["seed"]
        problem = Setting.from_dict(arguments.get("setting"), Trust(Path(folder), everything=trust)).problem
        return _computed(problem, held, held.latest(problem.shape_labels), arguments.get("reference"), seed)

    def answer(self) -> list[str]:
        """Sentences: how often each decider is right, with how many touches, which is best, and why the others fail."""
        return answer_sentences(self)

    def verdict(self) -> list[str]:
        """The answer, then sentences on differences and their significance, and whether stated confidence holds."""
        return verdict_sentences(self)

    def save(self, folder: str | Path) -> Path:
        """Write ``report.html`` with its figures and tables, and ``episodes.jsonl``; return the path of the page."""
        return self.report(folder).save(Path(folder))

    def report(self, folder: str | Path, with_searches: bool = True) -> Report:
        """The report for a folder, into which the searches are written, with some to step through; see :meth:`save`."""
        from experiments.search.page import report_of  # loads matplotlib

        if self.run is None:
            raise BadArgument("it was computed from episodes alone; save a comparison that activetouch.compare made")
        written = RunFolder(Path(folder))
        if self.run.folder.path is None or self.run.folder.path.resolve() != Path(folder).resolve():
            written.finish(self.run.searches.identity, self.run.arguments, self.run.lines())
        return report_of(written, self, self.run.searches, with_searches)


def compare(
    scene: str | Scene | NamedScene = "gel",
    deciders: Mapping[str, Decider | str] | Sequence[str] | str = DEFAULT_DECIDERS,
    *,
    episodes: int = 250,
    seed: int = 0,
    targets: Sequence[str] | str = (),
    sensor: str | Path | TactileSensor | None = None,
    out: str | Path | None = None,
    reference: str | None = None,
    full_information: bool = False,
    num_objects: int | None = None,
    composition: CompositionName | None = None,
    touch_cost: float = 0.02,
    unlisted: float = 0.0,
    prior: str | None = None,
    abstain: float | None = None,
    certificate: str | Path | Certificate | None = None,
    anyway: bool = False,
    jobs: int | None = None,
) -> Comparison:
    """Play live searches with several deciders on identical episodes, and compare them.

    The same deciders, scene, sensor and seed give the same numbers, in Python and on the command line.

    Args:
        scene: name of a scene, or a scene object.
        deciders: a name as on the command line or several, or a mapping from names in the report to deciders or names.
            Decider objects are pickled and sent to worker processes.
        episodes: searches per decider and target.
        seed: seed of the whole comparison.
        targets: shapes to search for, or one; all by default.
        sensor: sensor object, folder of a sensor, or name of a scene with a shipped sensor; by default the shipped
            sensor of ``scene``.
        out: folder in which finished episodes and the report are kept: after an interruption, the same call continues.
            By default they are kept in memory; :meth:`Comparison.save` writes them.
        reference: decider that the others are compared with; the first by default.
        full_information: whether to add what could be reached: every object is touched in every pose, before the most
            probable answer.
        num_objects: number of objects in a search; that of the scene by default.
        composition: "distinct", "independent", or "at_most_one", for many shapes: one object has the target's shape, or
            none. That of the scene by default.
        touch_cost: cost λ of one touch, in units of a success.
        unlisted: probability that an object has none of the shapes: such objects are of random bodies.
        prior: probabilities of shapes before the first touch, as the command takes them: "mug=.7,bowl=.3", or a file.
        abstain: false-alarm rate of the conflict test, with which every decider can answer "I do not know"; not by
            default.
        certificate: from :func:`activetouch.certify`, or its file; its decider also plays stopping by it, as
            "certified NAME", and searches can end with "I do not know".
        anyway: whether to accept a sensor that was made for another scene.
        jobs: number of processes; all cores by default.

    Returns:
        The comparison, with all numbers of the report.

    Raises:
        BadArgument: An argument is invalid.
        UnknownName: A name does not exist.
        WrongScene: The sensor was made for another scene.
        NotCertified: The certificate was made for something else.
        RunMismatch: The folder holds another run.

    Example::

        comparison = activetouch.compare("coarse", ["information_gain", "threshold"], episodes=20, targets="cone")
        print(comparison)
        comparison.save("runs/cone")
    """
    rules: dict[str, Any] = {"num_objects": num_objects, "composition": composition, "touch_cost": touch_cost}
    rules |= {"unlisted": unlisted, "prior": prior, "abstain": abstain}
    setting, named, own_sensor = setting_of(scene, sensor, **rules, anyway=anyway)
    run = prepared(
        setting,
        deciders,
        named,
        own_sensor,
        targets=targets,
        episodes=episodes,
        seed=seed,
        out=None if out is None else Path(out),
        reference=reference,
        full_information=full_information,
        jobs=jobs,
        certificate=certificate,
    )
    found = played(run, reference, jobs)
    if out is not None:
        found.save(out)
    return found


def setting_of(
    scene: str | Scene | NamedScene, sensor: str | Path | TactileSensor | None, **rules: Any
) -> tuple[Setting, NamedScene | None, TactileSensor | None]:
    """The setting of a scene and a sensor, and each of them that is an object without a name."""
    if not isinstance(scene, str | Scene | NamedScene):
        raise BadArgument(f"scene must be a name, a Scene or a NamedScene, got {scene!r:.80}")
    if not isinstance(sensor, str | Path | TactileSensor | None):
        raise WrongScene(f"{sensor!r:.80} is not of a scene: {NOT_SIMULATED}")
    names = [name for name, named in SCENES.items() if scene is named or scene is named.scene]
    name = scene if isinstance(scene, str) else names[0] if names else "own scene"
    named = None if isinstance(scene, str) or names else scene if isinstance(scene, NamedScene) else as_named(scene)
    own = sensor if isinstance(sensor, TactileSensor) else None
    folder = None if sensor is None or isinstance(sensor, TactileSensor) else Path(sensor)
    return Setting(SceneChoice(name), sensor=folder, **rules), named, own


def prepared(
    setting: Setting,
    deciders: Mapping[str, Decider | str] | Sequence[str] | str,
    named: NamedScene | None = None,
    own_sensor: TactileSensor | None = None,
    *,
    targets: Sequence[str] | str = (),
    episodes: int = 250,
    seed: int = 0,
    out: Path | None = None,
    reference: str | None = None,
    full_information: bool = False,
    jobs: int | None = None,
    certificate: str | Path | Certificate | None = None,
) -> Run:
    """Check all arguments of a comparison, which are those of :func:`compare`, before anything is played or written.

    ``named`` and ``own_sensor`` are a scene and a sensor object in place of those of the setting.
    """
    check_arguments(setting)
    for name, value, kind in (("episodes", episodes, Count), ("seed", seed, Seed), ("jobs", jobs, Jobs | None)):
        Constraint.of(kind).require(f"--{name}", value, BadArgument)
    players = _players(deciders)
    if reference is not None and reference not in players:
        raise UnknownName("reference among --deciders", reference, list(players))
    scene = setting.choice.named if named is None else named
    problem = setting.problem_in(scene)
    signed = None
    if certificate is not None:
        from planners.certified import Certificate

        signed = Certificate.opened(certificate)
    problem = problem if signed is None else problem.with_unsure()
    chosen = list(dict.fromkeys((targets,) if isinstance(targets, str) else targets)) or list(problem.shape_labels)
    for target in chosen:
        if target not in problem.shape_labels:
            raise UnknownName("target", target, list(problem.shape_labels))
        if target == ALL:
            raise BadArgument(
                f"a target cannot be called {ALL!r}, which stands for all of them in tables; write for "
                f"example my_all=all.obj, or choose others with --targets"
            )
    for player in players.values():
        if isinstance(player, str):
            found, named_as = find_decider(player)  # raises UnknownName
            if player.startswith(PREFIX):
                saved = build(player, found, named_as.settings, {}, True)
                for target in chosen:
                    saved.files(target)  # raises MissingPolicy
    if out is not None:
        require_writable(out)
        RunFolder(out).require(identity_of(scene.scene, problem, seed))  # before the sensor is prepared
    sensor = (
        setting.open_sensor(named, default_jobs() if jobs is None else jobs)
        if own_sensor is None
        else replace(own_sensor, scene=scene.scene)
    )
    folder = setting.sensor_folder
    for player in players.values():
        if isinstance(player, str):
            require_policies(player, chosen, setting.choice.scene, folder)
    is_fitted_here = own_sensor is not None or isinstance(sensor.model, GivesLogits)  # to the bodies of the scene
    files = [] if is_fitted_here else setting.sensor_files(scene.scene)
    digest = files_digest(files) if files else sensor.digest
    model = joint_model(sensor.model)
    if ANY_OBJECT_FILE not in [file.name for file in files] and model is not None:
        predict_contacts(sensor.reader, sensor.scene, model.num_hypotheses, jobs)
        # Workers have another cache, and models without groups send them the hypotheses of all poses anyway.
        if ENGINE.get() is not None and model.groups and isinstance(model.hypotheses, EmbedsByPose):
            for pose in range(model.num_poses):
                model.hypotheses.in_pose(model.num_hypotheses, pose)
    table = sensor.model.outcome_table()
    made = {
        name: copyable(player, table, sensor.model, folder / POLICIES, name=name) for name, player in players.items()
    }
    searches = Searches(sensor, problem, seed, setting.choice.scene, digest)
    for (name, decider), target in product(made.items(), chosen):
        with ForeignCode(f"in the first decision of {name}, target {target}"):
            knows_target = prepare(searches, decider, problem.shape_labels.index(target))
        if not knows_target and target == chosen[0] and len(chosen) > 1:
            print(f"warning: {name} sees no target: it plays all {len(chosen)} targets alike", file=sys.stderr)
    if setting.abstain is not None:
        from planners.abstaining import Abstaining

        made = {name: Abstaining(decider, setting.abstain) for name, decider in made.items()}
    known = {"observation model": sensor.model, "outcome table": table}
    if signed is not None:
        names = [name for name, player in players.items() if player == signed.decider]
        if not names:
            from planners.certified import NotCertified

            raise NotCertified(f"the certificate is for --deciders {signed.decider!r}, got {', '.join(players)}")
        for name in names:
            world = sensor.certified_world(problem, chosen, signed.decider, made[name], known)
            made[f"certified {name}"] = signed.wrap(made[name], world)
    if full_information:
        made[FULL_INFORMATION] = FullInformation()
    arguments = {
        "deciders": list(players),
        "reference": reference,
        "targets": [targets] if isinstance(targets, str) else list(targets),
        "episodes": episodes,
        "seed": seed,
        "setting": setting.to_dict() if named is None and own_sensor is None else None,
        **({"full_information": True} if full_information else {}),
        **({"certificate": str(certificate)} if isinstance(certificate, str | Path) else {}),
        **({"left_out": left_out} if (left_out := setting.choice.left_out) else {}),
    }
    return Run(searches, made, chosen, episodes, RunFolder(out), arguments, known)


def _players(deciders: Mapping[str, Decider | str] | Sequence[str] | str) -> dict[str, Decider | str]:
    """Deciders, or their names on the command line, by name in the report."""
    several = (deciders,) if isinstance(deciders, str) else deciders
    players: dict[str, Decider | str] = {name: name for name in several}
    if isinstance(several, Mapping):
        players = dict(several)
    if not players:
        raise BadArgument(f"--deciders must name one or more of {', '.join(DECIDERS)}; got none")
    for name, player in players.items():
        if not name:
            raise BadArgument("a decider cannot have an empty name")
        if not isinstance(player, str) and not callable(getattr(player, "decide", None)):
            raise BadArgument(f"{name!r} is not a decider: it has no method decide(info, rng), got {player!r:.80}")
    return players


def played(run: Run, reference: str | None, jobs: int | None) -> Comparison:
    """Play the searches that a run lacks, and compute the comparison of all."""
    run.play(jobs)
    return _computed(run.searches.problem, run.folder, run.lines(), reference, run.searches.seed, run)


def _computed(
    problem: SearchProblem,
    folder: RunFolder,
    lines: Mapping[Cell, list[str]],
    reference: str | None,
    seed: int,
    run: Run | None = None,
) -> Comparison:
    """The comparison of the episodes of a folder."""
    labels = tuple(problem.shape_labels)
    return Comparison.from_episodes(
        problem,
        {cell: [read_episode(line, labels) for line in own] for cell, own in lines.items()},
        {cell: folder.seconds(cell, own) for cell, own in lines.items()},
        reference or next(iter(lines))[0],
        np.random.default_rng(seed),
        run=run,
    )
