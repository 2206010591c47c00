"""Upper bound on the optimal value of a search."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planners.bounds.clairvoyant import clairvoyant_bound
from planners.bounds.joint_belief import JointBeliefBound, is_small
from planners.pomdp.problem import SearchTouchProblem
from planners.pomdp.touch_costs import TouchCosts


def search_bound(problem: SearchTouchProblem, rng: np.random.Generator, weights: Sequence[float] = (1.0,)) -> float:
    """Upper bound on the optimal value of a search at its start: the tightest that its size allows.

    Arguments are those of :func:`~planners.bounds.object.object_bound`, for a search.

    >>> perfect = SearchTouchProblem(np.eye(2)[None], 2, "distinct", target=0, touch_cost=0.1)
    >>> round(search_bound(perfect, np.random.default_rng(0)), 6)      # one touch decides between two shapes
    0.9
    """
    costs = TouchCosts(problem.touch_cost, problem.discount, weights)
    revealed = clairvoyant_bound(problem, costs, rng)(0, frozenset())
    if problem.num_objects > 1 and problem.discount == 1.0 and is_small(problem):
        return min(revealed, JointBeliefBound(problem, costs, rng)())
    return revealed
