"""One simulated object is touched until it is named, with the directions chosen by a rule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Literal, TypeAlias

import numpy as np

from activetouch.rotation_cells import centres
from activetouch.scene import WorldObject
from belief.coarse_to_fine import CoarseToFine
from belief.validation import Floats
from experiments.meshes.setting import MeshSetting

Rule: TypeAlias = Literal["information gain", "random", "fixed"]
RULES: tuple[Rule, ...] = ("information gain", "random", "fixed")
"""How the next direction is chosen; ``fixed`` is one order for all objects: :attr:`MeshSetting.best_order`."""

_SHOWN, _PROBABLE = 5, 0.01  # bodies that are still possible: at most, and their least probability


@dataclass(frozen=True, eq=False)
class Naming:
    """The touches of one object.

    Attributes:
        truth: index of its body.
        poses: of the touches.
        log_probs: posterior after each touch, ``(n, K)`` float32.
        possible: after each touch, the most probable bodies: index, probability, and how it lies most probably, a unit
            quaternion ``wxyz``.
        unresolved: share of the posterior in cells that are not of the finest level, after each touch.
        seconds: for the decisions, the updates and the closer looks, means of a touch.
    """

    truth: int
    poses: tuple[int, ...]
    log_probs: Floats
    possible: tuple[tuple[tuple[int, float, Floats], ...], ...]
    unresolved: tuple[float, ...]
    seconds: tuple[float, float, float]

    @property
    def named(self) -> int:
        """Index of the most probable body in the end."""
        return int(self.log_probs[-1].argmax())

    @property
    def stated(self) -> float:
        """Its probability."""
        return float(np.exp(self.log_probs[-1].max()))

    def touches_to(self, threshold: float) -> int | None:
        """Touches until a body is as probable as the threshold; None if that was not reached."""
        reached = np.flatnonzero(self.log_probs.max(axis=1) >= np.log(threshold))
        return int(reached[0]) + 1 if len(reached) else None


def name_object(
    setting: MeshSetting,
    obj: WorldObject,
    rule: Rule,
    seed: Sequence[int],
    max_touches: int = 16,
    threshold: float = 1.0,
) -> Naming:
    """Touch an object until a body is as probable as the threshold, or a number of touches is made.

    The same seed gives the same touch of an object in a pose, whatever the rule.

    Args:
        setting: bodies and sensor.
        obj: the object.
        rule: chooses directions; none is used twice.
        seed: of the touches and of the random order.
        max_touches: at most the number of poses.
        threshold: at which to stop, in (0, 1]; 1 does not stop.
    """
    num_poses = len(setting.scene.poses)
    order = np.random.default_rng([*seed, 1]).permutation(num_poses).tolist()
    if rule == "fixed":
        order = setting.best_order
    belief, poses = setting.bodies.start(), list[int]()
    logs, possible, unresolved, deciding, updating, looking = [], [], [], 0.0, 0.0, 0.0
    while len(poses) < min(max_touches, num_poses):
        started = perf_counter()
        pose = order[len(poses)]
        if rule == "information gain" and poses:
            gains = setting.information(belief)
            gains[poses] = -np.inf
            pose = int(gains.argmax())
        deciding += perf_counter() - started
        embedding = setting.touch(obj, pose, np.random.default_rng([*seed, 2, pose]))
        started = perf_counter()
        belief = setting.update(belief, pose, embedding)
        updating += perf_counter() - started
        started = perf_counter()
        belief = setting.looked(belief)
        logs.append(belief.log_probs.astype(np.float32))
        looking += perf_counter() - started
        poses.append(pose)
        unresolved.append(belief.unresolved)
        possible.append(still_possible(setting, belief))
        if np.exp(logs[-1].max()) >= threshold < 1.0:
            break
    seconds = deciding / len(poses), updating / len(poses), looking / len(poses)
    return Naming(obj.shape_index, tuple(poses), np.stack(logs), tuple(possible), tuple(unresolved), seconds)


def still_possible(setting: MeshSetting, belief: CoarseToFine) -> tuple[tuple[int, float, Floats], ...]:
    """The most probable bodies, at most five: see :class:`Naming`."""
    probs, leaves = belief.probs, belief.leaves(_PROBABLE / 100)
    found = []
    for body in np.argsort(-probs)[:_SHOWN].tolist():
        mine = np.flatnonzero(leaves.body == body)
        if probs[body] < _PROBABLE or not len(mine):
            break
        best = mine[leaves.log_weight[mine].argmax()]
        rests = centres(setting.bodies.levels[leaves.level[best]])
        found.append((body, float(probs[body]), rests[leaves.cell[best]]))
    return tuple(found)
