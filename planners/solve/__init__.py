"""Solve touch problems: plans whose value is certified from below and from above.

>>> import numpy as np
>>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])                       # one pose, right nine times of ten
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

from planners.pomdp.finite_horizon import finite_horizon_value
from planners.pomdp.problem import SearchTouchProblem, TouchProblem
from planners.solve.policy import SearchPolicy, TouchPolicy, solve_search, solve_touch
from planners.solve.policy_files import load_policy, save_policy

__all__ = [
    "SearchPolicy",
    "SearchTouchProblem",
    "TouchPolicy",
    "TouchProblem",
    "finite_horizon_value",
    "load_policy",
    "save_policy",
    "solve",
]


ROUNDS = (200, 200, 400, 400, 800)
"""Tests of one object simulated in each round of planning, by default: well below a second for four shapes."""
SEARCH_ROUNDS = (*ROUNDS, 2000)
"""The same for searches: one to three seconds for four objects."""


@overload
def solve(
    problem: TouchProblem, rng: np.random.Generator | None = None, rounds: Sequence[int] | None = None
) -> TouchPolicy: ...
@overload
def solve(
    problem: SearchTouchProblem, rng: np.random.Generator | None = None, rounds: Sequence[int] | None = None
) -> SearchPolicy: ...
def solve(
    problem: TouchProblem | SearchTouchProblem,
    rng: np.random.Generator | None = None,
    rounds: Sequence[int] | None = None,
) -> TouchPolicy | SearchPolicy:
    """Point-based value iteration; see :mod:`planners.pomdp.solver`.

    Args:
        problem: one object, or a search.
        rng: samples the beliefs to plan at; seed 0 by default, so that a problem has one solution.
        rounds: how many to simulate in each round of planning; more are slower and closer to the best. By default
            :data:`ROUNDS` for one object, :data:`SEARCH_ROUNDS` for a search.

    Raises:
        ValueError: touches cost nothing and nothing is discounted, or there are too many hidden states.
    """
    rng = rng if rng is not None else np.random.default_rng(0)
    if isinstance(problem, TouchProblem):
        return solve_touch(problem, rng, ROUNDS if rounds is None else rounds)
    return solve_search(problem, rng, SEARCH_ROUNDS if rounds is None else rounds)
