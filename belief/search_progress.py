"""The rules of a search, in one place: which object is current, what counts as a touch, and how a search ends.

Whoever plays searches keeps a :class:`SearchProgress`: sessions with a robot, the search loop, the environments.

>>> import numpy as np
>>> from belief.problem import Confirm, Reject, SearchProblem
>>> from belief.synthetic import random_model
>>> model = random_model(np.random.default_rng(0), num_shapes=2)
>>> progress = SearchProgress(SearchProblem(model.shape_labels, ("p0", "p1", "p2"), num_objects=2), model)
>>> _ = progress.touch(model.sample(0, [1], np.random.default_rng(0))[0])
>>> progress.act(Reject()), progress.object_index, progress.act(Confirm()).value
(None, 1, 'confirmed')
>>> success_of(progress.outcome, target=1, arrangement=(0, 1), object_index=1)
True
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from enum import StrEnum
from typing import Any

from numpy.typing import ArrayLike

from belief.categorical import Belief
from belief.naming import Name
from belief.observation_model.model import ObservationModel
from belief.problem import Action, Confirm, Reject, SearchProblem, Touch, Unsure
from belief.scene_belief import UNKNOWN, SceneBelief


class Outcome(StrEnum):
    """How a search ended."""

    CONFIRMED = "confirmed"
    EXHAUSTED = "exhausted"
    """Every object was rejected."""
    TRUNCATED = "truncated"
    """The touch limit was reached."""
    UNSURE = "unsure"
    """The decider answered "I do not know"."""


class SearchProgress:
    """The state of a search; its arguments are those of :class:`belief.scene_belief.SceneBelief`.

    ``num_touches`` is of the whole search, misses included; ``outcome`` is None until the search has ended.
    """

    def __init__(
        self,
        problem: SearchProblem,
        model: ObservationModel,
        prior: Belief | None = None,
        *,
        target: Name | None = None,
        log_bets: ArrayLike = 0.0,
    ) -> None:
        self.problem = problem
        self.scene = SceneBelief(problem, model, prior, target=target, log_bets=log_bets)
        self.num_rejected = self.num_touches = 0
        self.outcome: Outcome | None = None

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, scene=copy(state["scene"]))

    @property
    def object_index(self) -> int:
        """The current object; the last one if all were rejected."""
        return min(self.num_rejected, self.problem.num_objects - 1)

    @property
    def may_touch(self) -> bool:
        """Whether the touch limit allows one more touch."""
        return self.num_touches < self.problem.touch_limit

    def uses(self, pose: int) -> int:
        """Number of earlier touches of the current object in a pose."""
        return int(self.scene.touches(self.object_index).uses(self.problem.num_poses)[pose])

    def touch(self, touch: Touch) -> Belief:
        """Count a touch of the current object, and return the posterior about it."""
        belief = self.scene.update(self.object_index, [touch])
        self.num_touches += 1
        return belief

    def miss(self) -> None:
        """Count a press without contact: it is no evidence, but takes time, so it counts for the touch limit."""
        self.num_touches += 1

    def act(self, action: Action) -> Outcome | None:
        """Carry out an action that is no touch, and return how the search ended, or None.

        A probe stands for a touch that the touch limit forbids: it is not made, and ends the search.
        """
        if isinstance(action, Reject):
            self.num_rejected += 1
            if self.num_rejected == self.problem.num_objects:
                self.outcome = Outcome.EXHAUSTED
        elif isinstance(action, Confirm):
            self.outcome = Outcome.CONFIRMED
        else:
            self.outcome = Outcome.UNSURE if isinstance(action, Unsure) else Outcome.TRUNCATED
        return self.outcome


def success_of(outcome: Outcome | None, target: int, arrangement: Sequence[int], object_index: int) -> bool | None:
    """Whether a target was confirmed, or all objects were rejected and none was a target; None if that is unknown.

    ``arrangement`` holds the true shape of every object, or :data:`belief.scene_belief.UNKNOWN`.

    >>> success_of(Outcome.EXHAUSTED, 0, (1, UNKNOWN), 1), success_of(Outcome.EXHAUSTED, 0, (0, UNKNOWN), 1)
    (None, False)
    """
    if all(shape == UNKNOWN for shape in arrangement):
        return None
    if outcome is Outcome.CONFIRMED:
        shape = arrangement[object_index]
        return None if shape == UNKNOWN else shape == target
    if outcome is not Outcome.EXHAUSTED or target in arrangement:
        return False
    return None if UNKNOWN in arrangement else True
