"""``activetouch compare``: live searches on identical episodes for several deciders, and a report."""

from __future__ import annotations

import re
import sys
import textwrap
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from belief.composition import Composition
from belief.errors import ActiveTouchError, UnknownName
from belief.files import require_regular_file, require_writable, unsealed_json
from belief.problem import SearchProblem
from experiments.command_line.arguments import BadArgument, Count, Jobs, Seed, check_arguments, require_types
from experiments.command_line.console import plain_console
from experiments.command_line.trust import Trust
from experiments.parallel import default_jobs
from experiments.scene_choice import in_file_names, renderer_named
from experiments.search.holdings import Holdings, Selection
from experiments.search.resume import play_missing, shard_sizes
from experiments.search.run_folder import BOUND, ORACLE, RunFolder
from experiments.search.setting import Setting, prepare, require_abstain
from experiments.search.shards import made_by
from experiments.search.short_names import short_names
from experiments.search.summary import Comparison
from experiments.search.terminal import terminal_table
from experiments.search.verdict import verdict_sentences
from experiments.sensor_choice import require_policies, tell_shift
from experiments.sensor_commands import command
from planners.registry import DECIDERS, find_decider, summary_of

_DECIDERS_HELP = (
    "Deciders to compare. Settings follow in brackets: 'information_gain(confirm=0.97)'. Name your own as "
    "module:attribute: 'mine:TwoLooks(touches=4)', or a policy that Stable-Baselines3 saved: 'sb3:model.zip'. "
    "Available deciders:\n" + "\n".join(f"{name}: {summary_of(name)}" for name in DECIDERS)
)


@dataclass(frozen=True)
class Compare:
    """Search live in MuJoCo with several deciders on identical episodes; print a table and write a report.

    Finished episodes are kept: after an interruption, the same command continues. A larger --episodes extends a
    finished run. Several machines can share the work: as workers of a Dask cluster (--backend dask), or each with a
    part of the run (--part 1/2), which activetouch merge combines.

    For example:

        activetouch compare
        activetouch compare --deciders threshold information_gain --targets cone --episodes 1000 --out runs/cone
        activetouch compare --scene coarse
        activetouch compare --scenes coarse gel
        activetouch compare --scene coarse --abstain 0.02 --out runs/careful
        activetouch compare --renderers pressure gelsight --sensors 'runs/sensor-{scene}-{renderer}'
        activetouch compare --backend dask --scheduler tcp://10.0.0.1:8786
        activetouch compare --config runs/compare/run.json --seed 1 --out runs/again
    """

    deciders: Annotated[tuple[str, ...], tyro.conf.arg(help=_DECIDERS_HELP)] = (
        "point_based",
        "information_gain",
        "threshold",
        "random_confirm",
    )
    reference: str | None = None
    """Decider that the others are compared with; the first by default."""
    targets: tuple[str, ...] = ()
    """Shapes to search for; all by default."""
    episodes: Count = 250
    """Searches per decider and target."""
    seed: Seed = 0
    """Seed of the whole comparison."""
    setting: Annotated[Setting, tyro.conf.arg(name="")] = field(default_factory=Setting)
    """Setting of all episodes."""
    scenes: tuple[str, ...] = ()
    """Several scenes: one comparison for each, and an overview page; replaces --scene."""
    renderers: tuple[str, ...] = ()
    """Several renderers of every scene; replaces --renderer."""
    sensors: str | None = None
    """Folders of the sensors for --scenes and --renderers, with the placeholders {scene} and {renderer}; the shipped
    sensors by default."""
    out: Path | None = None
    """Folder of the run; by default runs/compare for the scene gel, runs/compare-SCENE for any other."""
    bound: bool = False
    """Also compute an upper bound on the expected return for the discretised sensor model (up to minutes per target).
    Live returns can exceed it, because live touches carry more information than their outcome and are correlated. For
    a sensor of one rigid body, also one for a decider that is shown orientation and size of each object."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""
    backend: Literal["loky", "dask"] = "loky"
    """Run on processes of this machine (loky) or on a Dask cluster (dask); the results do not depend on it."""
    scheduler: str | None = None
    """Address of the Dask scheduler, such as tcp://10.0.0.1:8786."""
    part: str = "1/1"
    """Run only part i of n, such as 2/8, and write no report."""
    config: Path | None = None
    """run.json of an earlier run. Its arguments, except --jobs, become the defaults; its folder becomes the default of
    --out."""
    trust: bool = False
    """Run code of your own that only --config or the folder of the run names, such as a decider module:attribute."""

    @classmethod
    def from_config(cls, path: Path) -> Compare:
        """The comparison that a ``run.json`` records, with the default number of jobs.

        Args:
            path: the file, or the folder of the run.

        Raises:
            BadArgument: The file is not the ``run.json`` of a comparison.
        """
        file = path / "run.json" if path.is_dir() else path
        if not require_regular_file(file, BadArgument).exists():
            raise BadArgument(f"--config {path} is not the run.json of a comparison: there is no file {file}")
        try:
            recorded = unsealed_json(file.read_text(encoding="utf-8"))["arguments"]
            given: dict[str, Any] = {
                key: tuple(value) if isinstance(value, list) else value for key, value in recorded.items()
            }
            del given["jobs"]
            setting = Setting.from_dict(given["setting"], Trust(path, everything=True))  # run() checks what remains
            found = cls(**{**given, "setting": setting, "out": file.parent, "config": path, "trust": False})
            require_types(found)
            return found
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise BadArgument(f"--config {path} is not the run.json of a comparison: {error}") from error

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        if self.out is not None:
            return self.out
        scene = self.setting.choice.scene
        return Path("runs/compare" if scene == "gel" else f"runs/compare-{in_file_names(scene)}")

    def run(self) -> None:
        """Run the missing searches, then print the results and write the report.

        Raises:
            FileNamesCode: ``config`` names code, and ``trust`` is not set.
        """
        if self.config is not None:
            asked = self._names()
            recorded = (name for name in Compare.from_config(self.config)._names() if name in asked)
            Trust(self.config, everything=self.trust).require(recorded)
        console = plain_console()
        worlds = self.worlds()
        found = {name: compare._run_one(console) for name, compare in worlds.items()}
        if len(worlds) > 1 and all(found.values()):
            from experiments.search.overview import write_overview  # loads jinja2

            root = next(iter(worlds.values())).folder.parent
            page = write_overview(root, {name: comparison for name, comparison in found.items() if comparison})
            console.print(f"overview: {page}", soft_wrap=True)

    def _names(self) -> list[str | None]:
        """Names of scenes, renderers and deciders, which can be code."""
        choice = self.setting.choice
        return [choice.scene, choice.renderer, *self.scenes, *self.renderers, *self.deciders]

    def worlds(self) -> dict[str, Compare]:
        """One comparison per requested scene and renderer, by name.

        Raises:
            BadArgument: Arguments exclude each other, such as --scene and --scenes.
            UnknownName: A scene or renderer does not exist.
        """
        choice = self.setting.choice
        if not self.scenes and not self.renderers:
            if self.sensors is not None:
                raise BadArgument("--sensors is for --scenes or --renderers; name a single sensor with --sensor")
            return {choice.scene: self}
        for plural, chosen in ((self.scenes, choice.scene != "gel"), (self.renderers, choice.renderer is not None)):
            if plural and chosen:
                raise BadArgument("give either --scene or --scenes, and either --renderer or --renderers")
        for name in self.renderers:
            renderer_named(name)  # raises UnknownName
        root, found = self.out if self.out is not None else Path("runs/compare-scenes"), {}
        for scene in dict.fromkeys(self.scenes or (choice.scene,)):
            for renderer in dict.fromkeys(self.renderers) or (choice.renderer,):
                name = in_file_names(scene if renderer is None else f"{scene}-{renderer}")
                sensor = self.setting.sensor
                if self.sensors is not None:
                    named = self.sensors.replace("{scene}", in_file_names(scene))
                    sensor = Path(named.replace("{renderer}", in_file_names(str(renderer))))
                setting = replace(self.setting, choice=replace(choice, scene=scene, renderer=renderer), sensor=sensor)
                found[name] = replace(self, scenes=(), renderers=(), sensors=None, setting=setting, out=root / name)
        return found

    def _run_one(self, console: Console) -> Comparison | None:
        if self.part != "1/1":
            self.fill()
            other, union = (self.folder.with_name(f"{self.folder.name}-{word}") for word in ("other", "all"))
            console.print(
                f"{self.folder} holds part {self.part}. If another part is in another folder, such as {other}, merge "
                f"them with:\n{command('merge', self.folder, other, out=union)}",
                soft_wrap=True,
            )
            return None
        comparison, report, notes = self.report()
        names, said = short_names(comparison.deciders)
        spoken = comparison.renamed(names)
        console.print(terminal_table(spoken, console.width).rich())
        for sentence in [*said, *verdict_sentences(spoken), *notes]:
            console.print(textwrap.fill(sentence, 78))
        console.print(f"report: {report}", soft_wrap=True)
        return comparison

    def report(self) -> tuple[Comparison, Path, list[str]]:
        """Run the missing searches and write the report.

        Returns:
            The requested comparison, the path of the page, and sentences about further searches in the folder.

        Raises:
            ActiveTouchError: as :meth:`play`.
        """
        from experiments.search.report import write_report  # loads matplotlib

        problem, holdings, asked = self._filled()
        shown, notes = self._largest(holdings, asked)
        chosen, reference, bounds = shown
        largest = holdings.compare(problem, chosen, reference, self.seed, bounds)
        page = write_report(self.folder, largest, self.setting, self.seed, notes)
        wanted = asked, self._reference, self.bound
        comparison = largest if wanted == shown else holdings.compare(problem, *wanted[:2], self.seed, self.bound)
        return comparison, page, notes

    def play(self) -> Comparison:
        """Run the missing searches, write ``episodes.jsonl`` and return the requested comparison.

        Raises:
            BadArgument: An argument is invalid.
            UnknownName: A decider or target does not exist.
            RunMismatch: The folder holds another run.
            CannotWrite: The disk is full, or the folder is not writable.
            NoCluster: The cluster cannot be reached.
            WorkerMismatch: A worker of the cluster has other versions.
        """
        problem, holdings, asked = self._filled()
        return holdings.compare(problem, asked, self._reference, self.seed, self.bound)

    def fill(self) -> tuple[SearchProblem, list[str]]:
        """Run the missing searches of this part; return the search and its targets. Raises as :meth:`play`."""
        problem, targets = self._check()
        players = [*dict.fromkeys(self.deciders), ORACLE, *([BOUND] if self.bound else [])]
        play_missing(
            RunFolder(self.folder),
            self.setting.resolved(),
            self.seed,
            shard_sizes(players, targets, self.episodes),
            self._arguments(),
            part=self._part(),
            jobs=self.jobs,
            scheduler=self.scheduler,
        )
        return problem, targets

    @property
    def _reference(self) -> str:
        return self.reference or self.deciders[0]

    def _filled(self) -> tuple[SearchProblem, Holdings, Selection]:
        """Run the missing searches; return the search, the content of the folder, and what was requested of it."""
        problem, targets = self.fill()
        setting, folder = self.setting.resolved(), RunFolder(self.folder)
        current: dict[str, dict[str, str]] = {}
        trust = Trust(self.folder, self.deciders, self.trust)
        for decider, by_target in folder.read_run()["made_by"].items():
            if not trust.allows(decider):
                print(f"warning: searches of {decider} in {self.folder} are left out; add --trust", file=sys.stderr)
                continue
            for target, digest in by_target.items():
                try:
                    now = made_by(setting, decider, target)
                except (ActiveTouchError, ValueError):
                    continue  # a decider that no longer exists
                if now == digest:
                    current.setdefault(decider, {})[target] = digest
        holdings = Holdings.of(folder, current)
        folder.write_episodes(holdings.episodes())
        return problem, holdings, Selection(tuple(dict.fromkeys(self.deciders)), tuple(targets), self.episodes)

    def _largest(self, holdings: Holdings, asked: Selection) -> tuple[tuple[Selection, str, bool], list[str]]:
        """What the report compares, with which reference, and whether with bounds; and sentences about the rest."""
        chosen, notes = holdings.largest(asked), []
        if chosen != asked:
            is_more = asked in chosen
            word = "contains more than was requested" if is_more else "keeps the larger comparison in this folder"
            notes.append(f"The report {word}: {chosen}.")
        if beyond := holdings.beyond(chosen):
            words = ", ".join(f"{num} of {name}" for name, num in beyond.items())
            notes.append(
                f"Not in the report, because not all of its deciders have run the same searches: {words} (see "
                f"{self.folder / 'episodes.jsonl'})."
            )
        reference = self._reference if self._reference in chosen.deciders else chosen.deciders[0]
        bounds = all((BOUND, target) in holdings.shards for target in chosen.targets)
        return (chosen, reference, bounds), notes

    def _part(self) -> tuple[int, int]:
        """Index of this part, from 0, and number of parts."""
        found = re.fullmatch(r"(\d+)/(\d+)", self.part)
        if found is None or not 1 <= int(found[1]) <= int(found[2]):
            raise BadArgument(f"--part must be i/n with 1 ≤ i ≤ n, such as 2/8; got {self.part!r}")
        return int(found[1]) - 1, int(found[2])

    def _check(self) -> tuple[SearchProblem, list[str]]:
        """Check all arguments before anything is run or written; return the search and its targets."""
        check_arguments(self)
        named, num_objects = self.setting.choice.named, self.setting.num_objects
        composition, shapes = self.setting.composition or named.composition, named.scene.shape_labels
        if num_objects is not None and num_objects > len(shapes) and composition == Composition.DISTINCT:
            raise BadArgument(
                f"--num-objects {num_objects}: the scene has only {len(shapes)} shapes ({', '.join(shapes)}), and all "
                "objects must differ; add --composition independent to allow several objects of one shape"
            )
        try:
            problem = self.setting.problem
        except ValueError as error:
            raise BadArgument(str(error)) from error
        require_abstain(self.setting)
        if self.bound and self.setting.abstain is not None:
            raise BadArgument("--bound is for searches without the answer UNSURE; leave out --bound or --abstain")
        shift = self.setting.shift  # raises WrongScene
        if not self.deciders:
            raise BadArgument(f"--deciders must name one or more of {', '.join(DECIDERS)}; got none")
        if (self.backend == "dask") != (self.scheduler is not None):
            raise BadArgument("--backend dask and --scheduler ADDRESS go together; start one with: dask scheduler")
        self._part()
        require_writable(self.folder)
        if self.reference is not None and self.reference not in self.deciders:
            raise UnknownName("reference among --deciders", self.reference, list(self.deciders))
        for target in self.targets:
            if target not in problem.shape_labels:
                raise UnknownName("target", target, list(problem.shape_labels))
        targets = list(dict.fromkeys(self.targets or problem.shape_labels))
        for player in map(self.setting.player, self.deciders):
            if isinstance(player, str):
                find_decider(player)
                require_policies(player, targets, self.setting.choice.scene, self.setting.sensor_folder)
        tell_shift(shift)
        prepare(self.setting, self.jobs)
        return problem, targets

    def _arguments(self) -> dict[str, object]:
        own = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in ("config", "trust")}
        return {**own, "out": str(self.folder), "setting": self.setting.to_dict()}
