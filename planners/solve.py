"""Solve touch problems: policies with a lower and an upper bound on the optimal value.

>>> import numpy as np
>>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])                       # one pose, right nine times in ten
>>> policy = solve(TouchProblem(table, prior=[0.5, 0.5], target=0, touch_cost=0.05))
>>> int(policy.action([0.5, 0.5])), int(policy.action([0.99, 0.01])), int(policy.action([0.01, 0.99]))
(0, 1, 2)
>>> bool(policy.lower_bound <= policy.upper_bound < policy.lower_bound + 1e-3)
True
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import overload

import numpy as np
from numpy.typing import NDArray

from belief.errors import InvalidArgument
from belief.validation import Floats, as_real, require_count
from planners.pomdp.policy import SearchPolicy, TouchPolicy
from planners.pomdp.problem import SearchTouchProblem, StagedProblem, TouchProblem, require_rounds, staged
from planners.pomdp.solver import point_based_value_iteration, repeat_aware_vectors

__all__ = [
    "SearchPolicy",
    "SearchTouchProblem",
    "StagedProblem",
    "TouchPolicy",
    "TouchProblem",
    "finite_horizon_value",
    "solve",
]


ROUNDS = (200, 200, 400, 400, 800)
"""Default number of simulated tests of one object per round of planning; takes well below a second for four shapes."""
SEARCH_ROUNDS = (*ROUNDS, 2000)
"""Default number of simulated searches per round of planning; takes one to three seconds for four objects."""


@overload
def solve(
    problem: TouchProblem, rng: np.random.Generator | None = None, rounds: Sequence[int] | None = None
) -> TouchPolicy: ...
@overload
def solve(
    problem: SearchTouchProblem | StagedProblem,
    rng: np.random.Generator | None = None,
    rounds: Sequence[int] | None = None,
    repeat_weights: Floats | None = None,
) -> SearchPolicy: ...
def solve(
    problem: TouchProblem | SearchTouchProblem | StagedProblem,
    rng: np.random.Generator | None = None,
    rounds: Sequence[int] | None = None,
    repeat_weights: Floats | None = None,
) -> TouchPolicy | SearchPolicy:
    """Point-based value iteration; see :mod:`planners.pomdp.solver`.

    Args:
        problem: one object, a search, or a search as stages.
        rng: samples the beliefs at which the solver works; seed 0 by default, so that a problem has one solution.
        rounds: number of simulated searches in each round; more take longer and give a higher value. By default
            :data:`ROUNDS` for one object, :data:`SEARCH_ROUNDS` for a search.
        repeat_weights: probability, in [0, 1], that the first, second, … touch of an object gives new information,
            ``(T,)``; for a repeat-aware policy (:mod:`planners.pomdp.solver`) of a search. None: every touch
            does.

    Raises:
        ValueError: touch cost 0 with discount 1, too many hidden states, repeat weights out of range or for a single
            object, or no rounds.
    """
    rounds = None if rounds is None else require_rounds(rounds)
    rng = rng if rng is not None else np.random.default_rng(0)
    if isinstance(problem, TouchProblem):
        if repeat_weights is not None:
            raise InvalidArgument("repeat_weights need a SearchTouchProblem, which may have num_objects = 1")
        vectors = point_based_value_iteration(staged(problem), rng, ROUNDS if rounds is None else rounds)
        return TouchPolicy(problem, vectors[0])
    weights = None if repeat_weights is None else np.asarray(as_real(repeat_weights, "repeat_weights"), np.float64)
    if weights is not None and not (weights.ndim == 1 and ((weights >= 0.0) & (weights <= 1.0)).all()):  # NaN fails too
        raise InvalidArgument(f"repeat_weights must be a row of numbers in [0, 1], got {weights.tolist()}")
    search = problem if isinstance(problem, StagedProblem) else staged(problem)
    vectors = point_based_value_iteration(search, rng, SEARCH_ROUNDS if rounds is None else rounds)
    if weights is None:
        return SearchPolicy(problem, tuple((of_stage,) for of_stage in vectors))
    return SearchPolicy(problem, repeat_aware_vectors(search, vectors, weights, rng))


_MAX_NUMBERS = 50_000_000  # in all stored histories and their weights


def finite_horizon_value(problem: TouchProblem, max_touches: int) -> float:
    """Value of the best policy with at most ``max_touches`` touches, exact up to rounding.

    Touches are independent given the shape, so histories that differ only in order are one history.

    Args:
        problem: may have a touch cost of zero.
        max_touches: number of touches after which only CONFIRM and REJECT are left, ≥ 0.

    Raises:
        InvalidArgument: ``max_touches`` is no integer ≥ 0, or the histories take more than 50 million numbers (0.4 GB).

    >>> table = [[[0.9, 0.1], [0.1, 0.9]]]                            # right nine times in ten
    >>> problem = TouchProblem(table, prior=[0.5, 0.5], target=0, touch_cost=0.05)
    >>> round(finite_horizon_value(problem, 0), 6), round(finite_horizon_value(problem, 1), 6)
    (0.0, 0.75)
    """
    require_count("max_touches", max_touches, least=0)
    num_poses, num_shapes, num_outcomes = problem.outcome_probs.shape
    num_items = num_poses * num_outcomes
    total = 0
    for depth in range(max_touches):  # stops early: a million touches take no longer than ten
        total += comb(num_items + depth - 1, depth) * (depth + num_shapes)
        if total > _MAX_NUMBERS:
            raise InvalidArgument(
                f"the histories of {max_touches} touches in {num_poses} poses with {num_outcomes} outcomes take more "
                f"than {_MAX_NUMBERS} numbers; use solve for a bound, or at most {depth} touches"
            )
    items = problem.outcome_probs.transpose(0, 2, 1).reshape(num_items, num_shapes)
    confirm = np.where(np.arange(num_shapes) == problem.target, 1.0, -1.0)
    if max_touches == 0:
        return abs(float(problem.prior @ confirm))
    # Weights p(shape, history) of all sorted histories, level by level; values are of weights, so nothing is divided.
    levels: list[tuple[NDArray[np.int64], Floats]] = [(np.empty((1, 0), np.int64), problem.prior[None])]
    for _ in range(max_touches - 1):
        histories, weights = levels[-1]
        last = histories[:, -1] if histories.shape[1] else np.zeros(1, np.int64)
        row, item = np.nonzero(np.arange(num_items) >= last[:, None])
        levels.append((np.column_stack([histories[row], item]), weights[row] * items[item]))
    value: Floats | None = None
    for histories, weights in reversed(levels):
        best = np.abs(weights @ confirm)
        cost = problem.touch_cost * weights.sum(axis=1)
        for pose in range(num_poses):
            mine = range(pose * num_outcomes, (pose + 1) * num_outcomes)
            after = np.zeros(len(weights))
            for number in mine:
                if value is None:  # after the last touch only CONFIRM and REJECT are left
                    after += np.abs((weights * items[number]) @ confirm)
                else:
                    longer = np.sort(np.column_stack([histories, np.full(len(histories), number)]), axis=1)
                    after += value[_rank(longer, num_items)]
            best = np.maximum(best, problem.discount * after - cost)
        value = best
    assert value is not None, "there is at least the level without touches"
    return float(value[0])


def _rank(histories: NDArray[np.int64], num_items: int) -> NDArray[np.int64]:
    """Place of sorted histories ``(H, depth)`` among all of that length, in lexicographic order."""
    depth = histories.shape[1]
    rank = np.zeros(len(histories), np.int64)
    previous: NDArray[np.int64] = np.zeros(len(histories), np.int64)
    for column in range(depth):
        left = depth - column - 1
        # Number of histories that continue with a smaller item.
        begun = np.array([comb(num_items - i + left - 1, left) if i < num_items else 0 for i in range(num_items + 1)])
        before = np.concatenate([[0], begun.cumsum()])
        rank += before[histories[:, column]] - before[previous]
        previous = histories[:, column]
    return rank
