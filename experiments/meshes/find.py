"""``activetouch find``: is the body of this mesh file among the objects in front of me, and which of them is it?

The searches are those of :func:`activetouch.compare`, in a scene of many shapes of which at most one object has the
target's.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.errors import MeshWarning
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.sensor.searching import UNLISTED_SHARE
from belief.errors import InvalidArgument
from belief.files import ends_claims
from belief.table import Table
from belief.validation import require_count
from experiments.command_line.arguments import Count
from experiments.meshes.near_twins import near_twins
from experiments.meshes.result import Bodies, MeshOptions, MeshResult, body_index, result_of, solids_of
from experiments.meshes.setting import SIZES, model_of, pad_of, plan_of, sensor_of
from experiments.scene_choice import SceneChoice
from experiments.search.comparison import Comparison, played, prepared
from experiments.search.play import Setting
from planners import Decider, Episode, Outcome
from planners.certified import Certificate

_TOUCHES = 12  # of an object, at most, in the mean of all
_PICTURED = 3  # searches


@dataclass(frozen=True, eq=False)
class Found(MeshResult):
    """Searches for the body with the label ``target``; prints as their table.

    Attributes:
        comparison: the same searches, with all numbers and reports of :func:`activetouch.compare`.
    """

    target: str
    comparison: Comparison
    _kind = "searches"
    _columns = (
        *(("result", ""), ("search", "d"), ("decider", ""), ("target", ""), ("answer", "")),
        *(("stated", ".3f"), ("touches", "d"), ("objects", "")),
    )
    _note = (
        "{right} of {number} answers are right, {low} to {high}; stated {stated:.2f} and {spent:.1f} touches "
        "in the mean."
    )

    def rows(self) -> list[dict[str, Any]]:
        """One row for each search: the objects, where the target was, the answer, its probability, and touches."""
        labels = self.sensor.shape_labels
        return [
            {
                "result": result_of(bool(one.success), one.is_answered, False),
                "search": number,
                "decider": decider,
                "objects": " ".join(labels[body] for body in one.arrangement),
                "target": self._place(one.arrangement.index(one.target) if one.target in one.arrangement else None),
                "answer": self._answer(one),
                "right": bool(one.success),
                "stated": stated(one),
                "touches": one.num_touches,
            }
            for decider in self.comparison.deciders
            for number, one in enumerate(self.comparison.of(decider), 1)
        ]

    def table(self) -> Table:
        """The rows, and how many are right; with the deciders, if there are several."""
        is_one = len({row["decider"] for row in self.rows()}) == 1
        return super().table().without(["decider"] * is_one)

    @staticmethod
    def _place(place: int | None) -> str:
        return "not there" if place is None else f"object {place + 1}"

    def _answer(self, episode: Episode) -> str:
        if not episode.is_answered:
            return "unsure" if episode.outcome is Outcome.UNSURE else "none: the touches were used up"
        return self._place(episode.steps[-1].object_index if episode.outcome is Outcome.CONFIRMED else None)

    @property
    def _title(self) -> str:
        return f"searches for {self.target}"

    @property
    def _question(self) -> str:
        return f"Where is {self.target}?"

    @property
    def _answered(self) -> str:
        return "searches are answered rightly"

    @property
    def _by_chance(self) -> float:
        return self.comparison.no_touch_baseline

    def _films(self) -> list[dict[str, Any]]:
        from experiments.search.page import story  # loads matplotlib

        played = [(decider, one) for decider in self.comparison.deciders for one in self.comparison.of(decider)]
        found = []
        for number, row in self._ordered()[:_PICTURED]:
            decider, one = played[number]
            by = f" by {decider}" if len(self.comparison.deciders) > 1 else ""
            title = f"Search {row['search']}{by}, {row['result']}: {row['answer']}; the truth: {row['target']}"
            found.append(story(self.sensor, self.comparison.problem, title, one) | {"together": False})
        return found

    def save(self, folder: Path | str) -> Path:
        """Write the report of the comparison, with the searches one by one and the bodies that feel alike."""
        whole, own = self.comparison.report(folder, with_searches=False), self.report().sections
        sections = [whole.sections[0], *own[1:], *whole.sections[1:]]
        return replace(whole, title=self._question, sections=sections).save(Path(folder))


def stated(episode: Episode) -> float:
    """Probability of the answer of a search for at most one target, by its recorded beliefs; of the best without one.

    The odds of each object follow from its last belief, when objects that come later were not touched.
    """
    last = {step.object_index: float(step.belief.probs[episode.target]) for step in episode.steps}
    number, weights = len(episode.arrangement), list[float]()
    for place in range(number):
        others = sum(weights) + number - place
        prob = min(last.get(place, 0.0), 1.0 - 1e-16) if place in last else None
        weights.append(1.0 if prob is None else others * prob / (1.0 - prob))
    probs = np.array([*weights, 1.0]) / (sum(weights) + 1.0)
    if not episode.is_answered:
        return float(probs.max())
    return float(probs[episode.steps[-1].object_index if episode.outcome is Outcome.CONFIRMED else -1])


def find(
    bodies: Bodies,
    target: str,
    *,
    num_objects: int | None = None,
    num_searches: int = 20,
    threshold: float = 0.95,
    deciders: Mapping[str, Decider | str] | Sequence[str] | str = (),
    certificate: str | Path | Certificate | None = None,
    unlisted: float = UNLISTED_SHARE,
    prior: str | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    scale: float | None = None,
    jobs: int | None = None,
    **setting: Any,
) -> Found:
    """Search for a body among simulated objects of other bodies; it may be absent.

    Args:
        bodies: a folder of mesh files, mesh files, or solids by label: what the objects may be.
        target: label of the body that is sought; the name of its file will do.
        num_objects: objects in front of the sensor, of different bodies; up to four by default.
        num_searches: number of searches. The target is as probable at each place as it is to be absent.
        threshold: probability of the answer at which to stop, of the usual decider.
        deciders: as of :func:`activetouch.compare`; by default that of the certificate, or information gain about the
            target, which stops at the threshold.
        certificate: as of :func:`activetouch.compare`.
        unlisted: as of :func:`activetouch.compare`.
        prior: as of :func:`activetouch.compare`.
        out: folder in which finished searches are kept, as of :func:`activetouch.compare`.
        seed: of objects and touches.
        scale: metres per unit of mesh files without a scale of their own.
        jobs: number of processes; as many as processors by default.
        setting: ``sensor``, and how closely bodies are examined: ``plan`` of views, ``levels``, ``effort``, ``look``,
            ``pressed`` (:class:`activetouch.perception.many_bodies.NestedPlan`).

    Raises:
        UnknownName: there is no such body.
        InvalidArgument: there are not more bodies than objects, or no mesh can be read.
    """
    solids, left_out = solids_of(bodies, scale)
    label, number = list(solids)[body_index(solids, target)], _num_objects(len(solids), num_objects)
    sensor = sensor_of(solids, setting.pop("sensor", "gel"), plan_of(**setting), jobs)
    named = NamedScene(sensor.scene, number, touches_per_object=_TOUCHES)
    run = prepared(
        Setting(composition="at_most_one", unlisted=unlisted, prior=prior),
        deciders or _usual_decider(threshold, number, certificate),
        named,
        sensor,
        targets=[label],
        episodes=num_searches,
        seed=seed,
        out=None if out is None else Path(out),
        jobs=jobs,
        certificate=certificate,
    )
    comparison = played(run, None, jobs)
    return Found(sensor, near_twins(model_of(sensor)), label, comparison, left_out=left_out)


def _num_objects(number: int, given: int | None) -> int:
    """Objects of a search among a number of bodies."""
    chosen = min(4, number - 1) if given is None else given
    require_count("num_objects", chosen)
    if number <= chosen:
        raise InvalidArgument(
            f"{chosen} different objects of {number} bodies would leave none out: add meshes, or use --objects "
            f"{number - 1}"
        )
    return chosen


def _usual_decider(threshold: float, num_objects: int, certificate: str | Path | Certificate | None) -> str:
    """That of a certificate, or one whose answer, an object or none of them, has the probability ``threshold``."""
    if certificate is not None:
        return Certificate.opened(certificate).decider
    reject = round(min((1.0 - threshold) / num_objects, threshold / 2.0), 6)
    return f"information_gain(confirm={threshold!r}, reject={reject!r}, max_touches=16)"


@dataclass(frozen=True, kw_only=True)
class Find(MeshOptions):
    """Find the object of one mesh among objects of other meshes by touch, in simulation: nothing is trained.

    The target may be absent. The first run makes views of each body, which are kept; the next starts at once. The
    searches are those of compare in this scene, so that compare --config, certify, replay and live know them, too.

    For example:

        activetouch find scans --target mug.obj
        activetouch find scans --target mug --objects 6 --deciders information_gain value_of_information --out runs/mug
    """

    target: str
    """Label of the body that is sought, or the name of its file."""
    objects: Count | None = None
    """Objects in front of the sensor; four by default, or one less than the bodies."""
    searches: Count = 20
    """Number of searches."""
    deciders: tuple[str, ...] = ()
    """Deciders, as of compare; by default information gain about the target."""
    certificate: Path | None = None
    """File from activetouch certify: its decider also plays stopping by it."""
    drawer: bool = False
    """The objects lie in a tray, at places that nobody knows: the searches of activetouch drawer."""
    out: Path = Path("runs/find")
    """Folder of the run and its report; finished searches are kept."""

    def _expected(self, number: int) -> tuple[float, float]:
        each = self.objects or min(4, number - 1)  # about as many touches as objects
        return self.searches * each * max(1, len(self.deciders)), min(self.searches, _PICTURED) * each

    @property
    def setting(self) -> Setting:
        """The setting of the searches, as of compare."""
        is_named = self.sensor in SCENES
        folder = self.folder if self.scale is None else Path(f"{self.folder}@{self.scale}")
        choice = SceneChoice(
            self.sensor if is_named else "gel",
            poses="directions26",
            meshes=(folder,),
            only=True,
            family=("size={}..{}".format(*SIZES),),
            pad=pad_of(self.sensor),
        )
        own = None if is_named else Path(self.sensor)
        rules: dict[str, Any] = {"composition": "at_most_one", "unlisted": self.unlisted, "prior": self.prior}
        return Setting(choice, own, self.objects, observation_model="nested", **rules)

    @ends_claims
    def run(self) -> None:
        """Read, make views, search, report."""
        if self.drawer:
            from activetouch.tray.world import Tray
            from experiments.search.drawer.drawer import USUAL_DECIDERS, report
            from experiments.search.drawer.searches import Searches  # whose modules no other search needs
            from planners.tray import TrayRules

            folder = self.folder if self.scale is None else Path(f"{self.folder}@{self.scale}")
            tray, rules = Tray(num_objects=self.objects or Tray.num_objects), TrayRules(sure=self.threshold)
            searches = Searches(self.sensor, folder, (), tray, rules, self.seed)
            report(searches, self.deciders or USUAL_DECIDERS, (self.target,), self.searches, self.out, self.jobs)
            return
        setting = self.setting
        solids, left_out = self.read(self.target, setting.choice)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)  # what is left out has been said
            label, labels = list(solids)[body_index(solids, self.target)], setting.choice.named.scene.shape_labels
        number = _num_objects(len(labels), self.objects)
        run = prepared(
            replace(setting, num_objects=number),
            self.deciders or _usual_decider(self.threshold, number, self.certificate),
            targets=[label],
            episodes=self.searches,
            seed=self.seed,
            out=self.out,
            jobs=self.jobs,
            certificate=self.certificate,
        )
        comparison, sensor = played(run, None, self.jobs), run.searches.sensor
        self.report(Found(sensor, near_twins(model_of(sensor)), label, comparison, left_out=left_out))
