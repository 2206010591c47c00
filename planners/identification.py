"""Identification of one object: touch it until the most probable label is probable enough, then name it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from belief.composition import Composition
from belief.errors import InvalidArgument
from belief.observation_model.model import ObservationModel
from belief.problem import SearchProblem, Unsure
from planners.decider import Decision, InformationState, ProbeSelector, SequentialDecider
from planners.search import World, next_touch
from planners.session import Session


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
    labels, poses = tuple(model.shape_labels), tuple(pose_labels)
    problem = SearchProblem(labels, poses, 1, Composition.INDEPENDENT, touch_limit=max_touches, unsure_reward=0.0)
    decider = SequentialDecider(_Certain(threshold, max_touches), selector)
    session = Session(problem, decider, 0, model, seed, abstain=False)
    world.reset()
    while (request := next_touch(session, world)) is not None:
        session.tell(world.touch(request.pose, request.rng))
    log_probs = session.belief.log_probs
    best = int(log_probs.argmax())
    stated = float(np.exp(log_probs[best]))
    touched = tuple(step.touch.pose for step in session.steps if step.touch is not None)
    return Identification(world.arrangement[0], best, stated, touched, stated >= threshold)


@dataclass(frozen=True)
class _Certain:
    """Stops where a label is probable enough, or after so many touches."""

    threshold: float
    max_touches: int

    def stop(self, info: InformationState) -> Decision | None:
        stated = float(np.exp(info.belief.log_probs.max()))
        return Decision(Unsure()) if stated >= self.threshold or len(info.history) >= self.max_touches else None
