"""The rules of a search, in one place: which object is current, what counts as a touch, and how a search ends.

Environments keep a :class:`BatchedProgress` of all their episodes; sessions with a robot, and the search loop, keep a
:class:`SearchProgress`, which is one search of a batch with its belief.

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
>>> many = BatchedProgress(progress.problem, 3)
>>> actions = np.array([0, 3, 4])                                # poses, then CONFIRM, REJECT and UNSURE
>>> many.act(actions, many.are_touches(actions))
>>> many.num_touches.tolist(), many.objects.tolist(), [many.outcome(row) for row in range(3)]
([1, 0, 0], [0, 0, 1], [None, <Outcome.CONFIRMED: 'confirmed'>, None])
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy, deepcopy
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.bayes import Belief
from belief.naming import UNKNOWN, Name
from belief.observation_model.model import ObservationModel
from belief.problem import Action, Confirm, Probe, Reject, SearchProblem, Touch, Unsure
from belief.scene_belief import SceneBelief


class Outcome(StrEnum):
    """How a search ended."""

    CONFIRMED = "confirmed"
    EXHAUSTED = "exhausted"
    """Every object was rejected."""
    TRUNCATED = "truncated"
    """The touch limit was reached."""
    UNSURE = "unsure"
    """The decider answered "I do not know"."""


OUTCOMES = tuple(Outcome)
CONFIRMED, EXHAUSTED, TRUNCATED, UNSURE = range(len(OUTCOMES))
ONGOING, NEVER = -1, -2
"""Instead of the index of an outcome: the search has not ended, and no outcome is right."""


class BatchedProgress:
    """Where B searches are: the rules for all of them at once.

    An action is an index: the poses, then CONFIRM, REJECT and UNSURE.

    Attributes:
        objects: the current ones, ``(B,)``; the last one stays once it is rejected.
        num_touches: of the whole search, misses included, ``(B,)``.
        outcomes: indices in :data:`OUTCOMES`, or :data:`ONGOING`, ``(B,)``.
    """

    def __init__(self, problem: SearchProblem, number: int) -> None:
        self._problem, self._rows = problem, np.arange(number)
        self.objects, self.num_touches = np.zeros(number, np.int64), np.zeros(number, np.int64)
        self.outcomes = np.full(number, ONGOING)
        self._ends = np.array([TRUNCATED] * problem.num_poses + [CONFIRMED, EXHAUSTED, UNSURE])  # by action

    @property
    def num_rejected(self) -> NDArray[np.int64]:
        """Objects put aside, ``(B,)``."""
        return self.objects + (self.outcomes == EXHAUSTED)

    @property
    def may_touch(self) -> NDArray[np.bool_]:
        """Whether the touch limit allows one more touch, ``(B,)``."""
        return self.num_touches < self._problem.touch_limit

    def outcome(self, row: int) -> Outcome | None:
        """How a search ended; None while it goes on."""
        index = self.outcomes[row]
        return None if index == ONGOING else OUTCOMES[index]

    def begin(self, rows: NDArray[np.int64]) -> None:
        """Begin new searches in these rows."""
        self.objects[rows], self.num_touches[rows], self.outcomes[rows] = 0, 0, ONGOING

    def are_touches(self, actions: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which actions are probes that the touch limit allows, ``(B,)``."""
        return (actions < self._problem.num_poses) & self.may_touch

    def act(self, actions: NDArray[np.int64], touched: NDArray[np.bool_]) -> None:
        """Count an action of every search, ``(B,)``; a probe that is not ``touched`` is not made, and truncates."""
        goes_to_next = (actions == self._problem.num_poses + 1) & (self.objects < self._problem.num_objects - 1)
        self.num_touches += touched
        self.objects += goes_to_next
        self.outcomes = self._ends.take(actions)
        self.outcomes[touched | goes_to_next] = ONGOING

    def are_right(self, right: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which searches have ended with their :func:`right_outcomes`, ``(B, N)``; ``(B,)``."""
        return self.outcomes == right[self._rows, self.objects]


def right_outcomes(targets: NDArray[np.int64], arrangements: NDArray[np.int64]) -> NDArray[np.int64]:
    """The outcome that is right at each object, ``(B, N)``, as :func:`success_of` says of known shapes."""
    is_target = arrangements == targets[:, None]
    return np.where(is_target, CONFIRMED, np.where(is_target.any(axis=1, keepdims=True), NEVER, EXHAUSTED))


class SearchProgress:
    """The state of a search; its arguments are those of :class:`belief.scene_belief.SceneBelief`.

    ``scene`` is the joint belief, ``object_index`` the current object (the last one stays once it is rejected),
    ``outcome`` None while the search goes on, and ``may_touch`` whether the touch limit allows one more touch.
    """

    object_index: int
    outcome: Outcome | None
    may_touch: bool

    def __init__(
        self,
        problem: SearchProblem,
        model: ObservationModel,
        prior: Belief | None = None,
        *,
        target: Name | None = None,
        log_bets: ArrayLike = 0.0,
    ) -> None:
        self.problem = problem = problem if target is None else problem.seeking(target)
        self.scene = SceneBelief(problem, model, prior, target=target, log_bets=log_bets)
        self._one = BatchedProgress(problem, 1)
        self._see()

    def _see(self) -> None:
        """Read where the search is."""
        self.object_index, self.outcome = int(self._one.objects[0]), self._one.outcome(0)
        self.may_touch = bool(self._one.may_touch[0])

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, scene=copy(state["scene"]), _one=deepcopy(state["_one"]))

    @property
    def num_rejected(self) -> int:
        """Objects put aside."""
        return int(self._one.num_rejected[0])

    @property
    def num_touches(self) -> int:
        """Number of touches of the whole search, misses included."""
        return int(self._one.num_touches[0])

    def uses(self, pose: int) -> int:
        """Number of earlier touches of the current object in a pose."""
        return int(self.scene.touches(self.object_index).uses(self.problem.num_poses)[pose])

    def touch(self, touch: Touch) -> Belief:
        """Count a touch of the current object, and return the posterior about it."""
        belief = self.scene.update(self.object_index, [touch])
        self.miss()
        return belief

    def miss(self) -> None:
        """Count a press without contact, which is no evidence: it takes its time, so the touch limit counts it."""
        self._one.num_touches += 1
        self._see()

    def act(self, action: Action) -> Outcome | None:
        """Carry out an action that is no touch, and return how the search ended, or None.

        A probe stands for a touch that the touch limit forbids: it is not made, and ends the search.
        """
        kinds = [isinstance(action, kind) for kind in (Confirm, Reject, Unsure)]
        index = action.pose if isinstance(action, Probe) else self.problem.num_poses + kinds.index(True)
        self._one.act(np.array([index]), np.array([False]))
        self._see()
        return self.outcome


def success_of(outcome: Outcome | None, target: int, arrangement: Sequence[int], object_index: int) -> bool | None:
    """Whether a target was confirmed, or all objects were rejected and none was a target; None if that is unknown.

    ``arrangement`` holds the true shape of every object, or :data:`belief.naming.UNKNOWN`.

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
