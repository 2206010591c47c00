"""Upper bound on the optimal value of a search."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from belief import Composition
from belief.errors import InvalidArgument
from belief.validation import Floats
from planners.pomdp.problem import SearchTouchProblem

from .clairvoyant import clairvoyant_bound
from .joint_belief import JointBeliefBound, is_small
from .object import ObjectBound
from .revealing_touch import RevealingTouchBound
from .touch_costs import TouchCosts

_MOST_SETS = 5000
"""Most sets of distinct shapes that rejected objects can have."""


def search_bound(problem: SearchTouchProblem, rng: np.random.Generator, weights: Sequence[float] = (1.0,)) -> float:
    """Upper bound on the optimal value of a search at its start: the tightest that its size allows.

    Arguments are those of :func:`~benchmarks.upper_bounds.object.object_bound`, for a search.

    >>> perfect = SearchTouchProblem(np.eye(2)[None], 2, "distinct", target=0, touch_cost=0.1)
    >>> round(search_bound(perfect, np.random.default_rng(0)), 6)      # one touch decides between two shapes
    0.9
    """
    costs = TouchCosts(problem.touch_cost, problem.discount, weights)

    @lru_cache(maxsize=1)  # grids are large, and none is needed again
    def bound_for(shapes: tuple[int, ...]) -> ObjectBound:
        return ObjectBound(problem.outcome_probs, np.array(shapes), costs, rng)

    revealed = clairvoyant_bound(problem, bound_for)(0, frozenset())
    if problem.num_objects > 1 and problem.discount == 1.0 and is_small(problem):
        return min(revealed, JointBeliefBound(problem, costs, rng)())
    return revealed


def revealing_touch_bound(
    problem: SearchTouchProblem,
    touches: int,
    weights: Sequence[float] = (1.0,),
    tables: Sequence[Floats] | None = None,
    names_rival: bool = False,
) -> float:
    """Upper bound on the value of a search: after some touches of an object one more reveals its shape.

    It needs no grid, so it is quick for many shapes too; see ``revealing_touch.py``. The shapes of
    rejected objects are revealed.

    Args:
        problem: the search.
        touches: number of touches of an object before the one that reveals its shape; each multiplies the time by up to
            the number of poses and outcomes.
        weights: as for :func:`search_bound`.
        tables: p(outcome | pose, shape) in equally likely circumstances of an object that are revealed at its first
            sight, each ``(P, K, M)``; the problem's table by default.
        names_rival: whether to use also that one rival of the target is named, which is tighter and takes longer.

    Raises:
        ValueError: distinct shapes of which too many sets can have been rejected.

    >>> perfect = SearchTouchProblem(np.eye(2)[None], 2, "distinct", target=0, touch_cost=0.1)
    >>> revealing_touch_bound(perfect, touches=1)
    0.9
    """
    distinct = problem.composition is Composition.DISTINCT
    if distinct and problem.num_states > _MOST_SETS * problem.num_shapes:
        raise InvalidArgument(
            f"a bound for {problem.num_objects} distinct objects of {problem.num_shapes} shapes needs too many sets of "
            f"rejected shapes, more than {_MOST_SETS}; ask for fewer shapes or objects"
        )
    costs = TouchCosts(problem.touch_cost, problem.discount, weights)
    bound = RevealingTouchBound(tables if tables is not None else [problem.outcome_probs], costs, touches, names_rival)
    return clairvoyant_bound(problem, lambda _: bound)(0, frozenset())
