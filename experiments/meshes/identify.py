"""``activetouch identify``: which of the bodies in a folder of meshes is it? Nothing is trained for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.scene import WorldObject
from belief.claims import ends_claims
from belief.validation import Floats
from experiments.command_line.arguments import Count
from experiments.meshes.near_twins import near_twins
from experiments.meshes.result import Bodies, MeshOptions, MeshResult, body_index, solids_of
from experiments.meshes.setting import MeshSetting, Possible
from experiments.parallel import Shared, run_tasks

_PICTURED = 6  # objects


@dataclass(frozen=True, eq=False)
class Naming:
    """The touches of one object; ``log_probs (n, K)`` float32 and the most probable bodies are after each touch."""

    truth: int
    poses: tuple[int, ...]
    log_probs: Floats
    possible: tuple[Possible, ...]

    @property
    def named(self) -> int:
        """Index of the most probable body in the end."""
        return int(self.log_probs[-1].argmax())

    @property
    def stated(self) -> float:
        """Probability of the most probable body in the end."""
        return float(np.exp(self.log_probs[-1].max()))


def name_object(
    setting: MeshSetting,
    obj: WorldObject,
    seed: Sequence[int],
    max_touches: int = 16,
    threshold: float = 1.0,
    order: Sequence[int] | None = None,
) -> Naming:
    """Touch an object until a body is as probable as the threshold (1 does not stop), or a number of touches is made.

    The same seed gives the same touch of an object in a pose, whatever the order. Without an ``order``, the first pose
    is random, and each later one is expected to tell most.
    """
    num_poses = len(setting.scene.poses)
    first = int(np.random.default_rng([*seed, 1]).permutation(num_poses)[0])
    belief, poses = setting.bodies.start(), list[int]()
    logs, possible = list[Floats](), list[Possible]()
    while len(poses) < min(max_touches, num_poses):
        chosen = setting.next_pose(belief, poses) if poses and order is None else first
        pose = chosen if order is None else order[len(poses)]
        belief = setting.touched(belief, obj, pose, np.random.default_rng([*seed, 2, pose]))
        poses.append(pose)
        logs.append(belief.log_probs.astype(np.float32))
        possible.append(setting.possible(belief))
        if np.exp(logs[-1].max()) >= threshold < 1.0:
            break
    return Naming(obj.shape_index, tuple(poses), np.stack(logs), tuple(possible))


@dataclass(frozen=True, eq=False)
class Identified(MeshResult):
    """Simulated objects, and how they were named; prints as their table."""

    namings: Sequence[Naming]
    _kind = "objects"
    _columns = ("body", ""), ("named", ""), ("stated", ".3f"), ("touches", "d")
    _note = "{right} of {number} named rightly, {low} to {high}; stated {stated:.2f} in the mean."

    def rows(self) -> list[dict[str, Any]]:
        """One row for each object: its body, the named one, the stated probability, and touches."""
        labels = self.setting.bodies.labels
        return [
            {
                "body": labels[one.truth],
                "named": labels[one.named],
                "right": one.named == one.truth,
                "stated": one.stated,
                "touches": len(one.poses),
                "directions": " ".join(self.setting.scene.pose_labels[pose] for pose in one.poses),
            }
            for one in self.namings
        ]

    @property
    def _title(self) -> str:
        return f"objects among {len(self.setting.bodies.labels)} bodies"

    @property
    def _question(self) -> str:
        return "Which body is it?"

    def _shown(self) -> Iterator[tuple[str, str, Sequence[str], Sequence[Possible]]]:
        labels = self.setting.bodies.labels
        for number, one in enumerate(self.namings[:_PICTURED], 1):
            right = "rightly" if one.named == one.truth else f"wrongly: it is {labels[one.truth]}"
            end = f"named {labels[one.named]} with probability {one.stated:.3f}, {right}"
            sides = [f"side {self.setting.scene.pose_labels[pose]}" for pose in one.poses]
            yield f"Object {number}", f"After {len(one.poses)} touches {end}.", sides, one.possible


def identify(
    bodies: Bodies,
    *,
    body: str | None = None,
    num_objects: int = 20,
    threshold: float = 0.95,
    max_touches: int = 16,
    seed: int = 0,
    scale: float | None = None,
    jobs: int | None = None,
    **setting: Any,
) -> Identified:
    """Press simulated objects of some bodies, and name each by touch.

    Args:
        bodies: a folder of mesh files, mesh files, or solids by label.
        body: label of the objects' body; random bodies by default.
        num_objects: number of objects.
        threshold: probability at which to stop touching an object.
        max_touches: of an object, at most 26.
        seed: of objects and touches.
        scale: metres per unit of mesh files without a scale of their own.
        jobs: number of processes; as many as processors by default.
        setting: further arguments of :meth:`MeshSetting.of`, such as ``sensor`` and ``plan``.

    Raises:
        UnknownName: there is no such body.
        InvalidArgument: no mesh can be read, or the sensor has no reader of any object.
    """
    solids, left_out = solids_of(bodies, scale)
    chosen = None if body is None else body_index(solids, body)
    made = MeshSetting.of(solids, jobs=jobs, **setting)
    truths = np.random.default_rng([seed, 5]).permutation(np.arange(num_objects) % len(solids)).tolist()
    shared = Shared(made)
    tasks = [
        partial(_name_one, shared, truth if chosen is None else chosen, [seed, number], max_touches, threshold)
        for number, truth in enumerate(truths)
    ]
    return Identified(made, near_twins(made), list(run_tasks(tasks, jobs, "objects")), left_out=left_out)


def _name_one(
    shared: Shared[MeshSetting], truth: int, seed: Sequence[int], max_touches: int, threshold: float
) -> Naming:
    obj = shared.value.scene.sample_object(truth, np.random.default_rng([*seed, 0]))
    return name_object(shared.value, obj, seed, max_touches, threshold)


@dataclass(frozen=True, kw_only=True)
class Identify(MeshOptions):
    """Name the bodies of a folder of meshes by touch, in simulation: nothing is trained.

    The first run makes views of each body, which are kept; the next starts at once.

    For example:

        activetouch identify scans
        activetouch identify scans --body mug --objects 5 --out runs/mug
        activetouch identify scans --scale 0.001
    """

    body: str | None = None
    """Label of the body that is pressed; random ones by default."""
    objects: Count = 20
    """Number of objects to name."""
    max_touches: Count = 16
    """Touches of an object, at most 26."""
    out: Path = Path("runs/identify")
    """Folder for the report."""

    def _expected(self, number: int) -> tuple[float, float]:
        each = min(self.max_touches, 1.0 + np.log(number))  # 1.3 of 4 bodies, 2.5 of 12, 4 of 100, 8 of 999
        return self.objects * each, min(self.objects, _PICTURED) * each

    @ends_claims
    def run(self) -> None:
        """Read, make views, name, report."""
        (solids, left_out), told = self.read(self.body), self.common | {"max_touches": self.max_touches}
        found = identify(solids, body=self.body, num_objects=self.objects, **told)
        self.report(replace(found, left_out=left_out))
