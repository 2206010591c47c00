"""What no policy for a search can exceed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planners.bounds.clairvoyant import told_shapes
from planners.bounds.joint_belief import UntoldBound, is_small
from planners.pomdp.problem import SearchTouchProblem
from planners.pomdp.touch_costs import TouchTerms


def search_bound(problem: SearchTouchProblem, rng: np.random.Generator, weights: Sequence[float] = (1.0,)) -> float:
    """What no policy for a search exceeds at its start, by the tightest bound there is for a search of its size.

    Args:
        problem: the search.
        rng: samples where grids are fine; any grid gives a bound.
        weights: what each touch of an object is worth, see :class:`~planners.pomdp.touch_costs.TouchTerms`.

    >>> perfect = SearchTouchProblem(np.eye(2)[None], 2, "distinct", target=0, touch_cost=0.1)
    >>> round(search_bound(perfect, np.random.default_rng(0)), 6)      # one touch tells which of the two it is
    0.9
    """
    terms = TouchTerms(problem.touch_cost, problem.discount, weights)
    told = told_shapes(problem, terms, rng)(0, frozenset())
    if problem.num_objects > 1 and problem.discount == 1.0 and is_small(problem):
        return min(told, UntoldBound(problem, terms, rng)())
    return told
