"""Identification of one object: touch it until the most probable label is probable enough, then name it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from belief.composition import Composition
from belief.errors import InvalidArgument
from belief.observation_model.model import ObservationModel
from belief.problem import Probe, SearchProblem
from belief.scene_belief import SceneBelief
from belief.seeding import checked_key, deciding_rng, touch_rng
from planners.decider import InformationState, ProbeSelector
from planners.search import World


@dataclass(frozen=True)
class Identification:
    """How an object was named.

    Attributes:
        truth: index of its label.
        named: index of the label that was named.
        stated: probability of that label.
        poses: of the touches.
        is_certain: whether the stated probability reached the threshold.
    """

    truth: int
    named: int
    stated: float
    poses: tuple[int, ...]
    is_certain: bool

    @property
    def is_right(self) -> bool:
        """Whether the named label is the true one."""
        return self.named == self.truth


def identify(
    world: World,
    selector: ProbeSelector,
    model: ObservationModel,
    pose_labels: Sequence[str],
    seed: int | Sequence[int],
    threshold: float = 0.9,
    max_touches: int = 12,
) -> Identification:
    """Touch the first object of a world until a label has the probability ``threshold``, or ``max_touches`` are made.

    Args:
        world: its first object is touched.
        selector: chooses the poses. What it knows of a target is label 0 and means nothing.
        model: likelihood of touches; its labels are equally probable before the first.
        pose_labels: names of the P poses.
        seed: of the touches and of the selector.
        threshold: probability at which to stop, in (0, 1].
        max_touches: ≥ 1.

    Raises:
        InvalidArgument: the threshold is out of its range.

    >>> from belief.synthetic import SyntheticWorld, random_model
    >>> from planners.probing import GivenOrder
    >>> model = random_model(np.random.default_rng(0), sharpness=4.0)
    >>> found = identify(SyntheticWorld(model, [2]), GivenOrder(("a", "b", "c")), model, ("a", "b", "c"), seed=1)
    >>> found.is_right, found.is_certain, found.poses
    (True, True, (0,))
    """
    if not 0.0 < threshold <= 1.0:
        raise InvalidArgument(f"threshold must be in (0, 1], got {threshold!r}")
    words = checked_key(seed)
    rng, labels = deciding_rng(words), tuple(model.shape_labels)
    problem = SearchProblem(labels, tuple(pose_labels), 1, Composition.INDEPENDENT, touch_limit=max_touches)
    world.reset()
    scene, poses = SceneBelief(problem, model), list[int]()
    while True:
        info = InformationState.of(problem, 0, scene, 0)
        best = int(info.belief.log_probs.argmax())
        stated = float(np.exp(info.belief.log_probs[best]))
        if stated >= threshold or len(poses) >= max_touches:
            return Identification(world.arrangement[0], best, stated, tuple(poses), stated >= threshold)
        action = selector.choose(info, rng).action
        assert isinstance(action, Probe), "a probe selector probes"
        touch = world.touch(action.pose, touch_rng(words, 0, action.pose, int(info.uses[action.pose])))
        scene.update(0, [touch])
        poses.append(action.pose)
