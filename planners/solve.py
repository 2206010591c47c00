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
from typing import overload

import numpy as np

from belief.errors import InvalidArgument
from belief.validation import Floats, as_real
from planners.pomdp.finite_horizon import finite_horizon_value
from planners.pomdp.policy import SearchPolicy, TouchPolicy
from planners.pomdp.problem import SearchTouchProblem, TouchProblem, require_rounds
from planners.pomdp.solver import point_based_value_iteration, repeat_aware_vectors
from planners.pomdp.stages import StagedProblem, staged

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
