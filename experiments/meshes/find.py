"""``activetouch find``: is the body of this mesh file among the objects in front of me, and which of them is it?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp, softmax

from belief.claims import ends_claims
from belief.coarse_to_fine import CoarseToFine
from belief.errors import InvalidArgument
from belief.validation import Floats, require_count
from experiments.command_line.arguments import Count
from experiments.meshes.near_twins import near_twins
from experiments.meshes.result import Bodies, MeshOptions, MeshResult, body_index, solids_of
from experiments.meshes.setting import MeshSetting, Possible
from experiments.parallel import Shared, run_tasks

_EACH = 16  # touches of an object, at most
_PICTURED = 3  # searches


@dataclass(frozen=True, eq=False)
class Search:
    """One search for the target; places are numbers of objects, and the number of objects stands for "not there".

    ``objects`` are indices of bodies, ``touches`` pairs of object and pose. After each touch: ``places (n, objects +
    1)``, the probability of each place, and ``possible``, the most probable bodies of the touched object.
    """

    objects: tuple[int, ...]
    truth: int
    answer: int
    stated: float
    touches: tuple[tuple[int, int], ...]
    places: Floats
    possible: tuple[Possible, ...]


@dataclass(frozen=True, eq=False)
class Found(MeshResult):
    """Searches for the body with the label ``target``; prints as their table."""

    target: str
    searches: Sequence[Search]
    _kind = "searches"
    _columns = ("target", ""), ("answer", ""), ("stated", ".3f"), ("touches", "d"), ("objects", "")
    _note = (
        "{right} of {number} answers are right, {low} to {high}; stated {stated:.2f} and {spent:.1f} touches "
        "in the mean."
    )

    def rows(self) -> list[dict[str, Any]]:
        """One row for each search: the objects, where the target was, the answer, its probability, and touches."""
        labels = self.setting.bodies.labels
        return [
            {
                "objects": " ".join(labels[body] for body in one.objects),
                "target": self._place(one.truth, one),
                "answer": self._place(one.answer, one),
                "right": one.answer == one.truth,
                "stated": one.stated,
                "touches": len(one.touches),
            }
            for one in self.searches
        ]

    @staticmethod
    def _place(place: int, search: Search) -> str:
        return "not there" if place == len(search.objects) else f"object {place + 1}"

    @property
    def _title(self) -> str:
        return f"searches for {self.target}"

    @property
    def _question(self) -> str:
        return f"Where is {self.target}?"

    def _shown(self) -> Iterator[tuple[str, str, Sequence[str], Sequence[Possible]]]:
        for number, one in enumerate(self.searches[:_PICTURED], 1):
            words = [
                f"object {place + 1}, side {self.setting.scene.pose_labels[pose]}; the target is probably "
                f"{self._place(int(probs.argmax()), one)} ({probs.max():.2f})"
                for (place, pose), probs in zip(one.touches, one.places, strict=True)
            ]
            end = f"The answer is {self._place(one.answer, one)}; the truth is {self._place(one.truth, one)}."
            yield f"Search {number}", end, words, one.possible


def find(
    bodies: Bodies,
    target: str,
    *,
    num_objects: int | None = None,
    num_searches: int = 20,
    threshold: float = 0.95,
    seed: int = 0,
    scale: float | None = None,
    jobs: int | None = None,
    **setting: Any,
) -> Found:
    """Search for a body among simulated objects of other bodies; it may be absent.

    The next touch is of the object that is most probably the target.

    Args:
        bodies: a folder of mesh files, mesh files, or solids by label: what the objects may be.
        target: label of the body that is sought; the name of its file will do.
        num_objects: objects in front of the sensor, of different bodies; up to four by default.
        num_searches: number of searches. The target is equally often at each place and absent.
        threshold: probability of the answer at which to stop.
        seed: of objects and touches.
        scale: metres per unit of mesh files without a scale of their own.
        jobs: number of processes; as many as processors by default.
        setting: further arguments of :meth:`MeshSetting.of`.

    Raises:
        UnknownName: there is no such body.
        InvalidArgument: there are not more bodies than objects, or no mesh can be read.
    """
    solids, left_out = solids_of(bodies, scale)
    sought = body_index(solids, target)
    num_objects = min(4, len(solids) - 1) if num_objects is None else num_objects
    require_count("num_objects", num_objects)
    if len(solids) <= num_objects:
        raise InvalidArgument(
            f"{num_objects} different objects of {len(solids)} bodies would leave none out: add meshes, or use "
            f"--objects {len(solids) - 1}"
        )
    made = MeshSetting.of(solids, jobs=jobs, **setting)
    shared = Shared(made)
    tasks = [
        partial(_search_one, shared, sought, num_objects, threshold, [seed, number]) for number in range(num_searches)
    ]
    searches = list(run_tasks(tasks, jobs, "searches"))
    return Found(made, near_twins(made), made.bodies.labels[sought], searches, left_out=left_out)


def _search_one(
    shared: Shared[MeshSetting], target: int, num_objects: int, threshold: float, seed: Sequence[int]
) -> Search:
    """One search: touch the object that is most probably the target until the answer is probable enough."""
    setting = shared.value
    rng, number = np.random.default_rng([*seed, 0]), len(setting.bodies.labels)
    others = rng.permutation(np.delete(np.arange(number), target))[:num_objects]
    truth = int(rng.integers(num_objects + 1))
    drawn = [target if place == truth else int(other) for place, other in enumerate(others)]
    objects = [setting.scene.sample_object(body, rng) for body in drawn]
    num_poses = len(setting.scene.poses)
    log_prior = np.full(number, np.log(num_objects / (num_objects + 1) / (number - 1)))
    log_prior[target] = -np.log(num_objects + 1)
    beliefs = [setting.bodies.start(log_prior)] * num_objects
    first = int(rng.permutation(num_poses)[0])
    used: list[list[int]] = [[] for _ in objects]
    touches, places, possible = [], [], []
    probs = np.full(num_objects + 1, 1 / (num_objects + 1))
    while probs.max() < threshold:
        ready = [place for place in range(num_objects) if len(used[place]) < min(_EACH, num_poses)]
        if not ready:
            break
        place = max(ready, key=lambda each: probs[each])
        pose = setting.next_pose(beliefs[place], used[place], target) if used[place] else first
        touch_rng = np.random.default_rng([*seed, 1, place, pose])
        beliefs[place] = setting.touched(beliefs[place], objects[place], pose, touch_rng)
        used[place].append(pose)
        probs = softmax([*(_log_odds(belief, target) for belief in beliefs), 0.0])
        touches.append((place, pose))
        places.append(probs)
        possible.append(setting.possible(beliefs[place]))
    answer = int(probs.argmax())
    return Search(
        tuple(drawn), truth, answer, float(probs[answer]), tuple(touches), np.reshape(places, (-1, len(probs))),
        tuple(possible),
    )  # fmt: skip


def _log_odds(belief: CoarseToFine, target: int) -> float:
    """Log likelihood ratio of an object being the target, against being one of the other bodies."""
    evidence = belief.log_evidence
    others = np.delete(evidence, target)
    return float(evidence[target] - (logsumexp(others) - np.log(len(others))))


@dataclass(frozen=True, kw_only=True)
class Find(MeshOptions):
    """Find the object of one mesh among objects of other meshes by touch, in simulation: nothing is trained.

    The target may be absent. The first run makes views of each body, which are kept; the next starts at once.

    For example:

        activetouch find scans --target mug.obj
        activetouch find scans --target mug --objects 6 --out runs/mug
    """

    target: str
    """Label of the body that is sought, or the name of its file."""
    objects: Count | None = None
    """Objects in front of the sensor; four by default, or one less than the bodies."""
    searches: Count = 20
    """Number of searches."""
    out: Path = Path("runs/find")
    """Folder for the report."""

    def _expected(self, number: int) -> tuple[float, float]:
        each = self.objects or min(4, number - 1)  # about as many touches as objects
        return self.searches * each, min(self.searches, _PICTURED) * each

    @ends_claims
    def run(self) -> None:
        """Read, make views, search, report."""
        solids, left_out = self.read(self.target)
        found = find(solids, self.target, num_objects=self.objects, num_searches=self.searches, **self.common)
        self.report(replace(found, left_out=left_out))
