"""Upper bound for a search: a searcher who is told the shape of every object it rejects can only do better."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np

from belief import Composition
from planners.bounds.object import ObjectBound
from planners.pomdp.problem import SearchTouchProblem
from planners.pomdp.touch_costs import TouchTerms


def told_shapes(
    problem: SearchTouchProblem, terms: TouchTerms, rng: np.random.Generator
) -> Callable[[int, frozenset[int]], float]:
    """What the told searcher is worth at most, by how many objects it has rejected and which shapes matter of those.

    Its belief is about the current object only, so every stage is a problem of one object, the last one first. All
    rejected shapes matter if shapes are distinct, otherwise whether the target was among them.

    Args:
        problem: the search.
        terms: on which each object can be touched.
        rng: samples where grids are fine; any grid gives a bound.
    """
    num_shapes, target, prior = problem.num_shapes, problem.target, problem.prior
    assert prior is not None, "filled in at construction"
    confirm = np.where(np.arange(num_shapes) == target, 1.0, -1.0)
    distinct = problem.composition is Composition.DISTINCT

    @lru_cache(maxsize=1)  # grids are large, and the one for other shapes is not asked for again
    def bound_for(shapes: tuple[int, ...]) -> ObjectBound:
        return ObjectBound(problem.outcome_probs, np.array(shapes), terms, rng)

    @cache
    def value(number: int, gone: frozenset[int]) -> float:
        if number == problem.num_objects:
            return -1.0 if target in gone else 1.0
        belief = np.where(np.isin(np.arange(num_shapes), list(gone)), 0.0, 1.0) if distinct else prior.copy()
        belief /= belief.sum()
        possible = np.flatnonzero(belief > 0.0)
        reject = np.full(num_shapes, -1.0)
        for shape in possible.tolist():
            matters = distinct or shape == target
            reject[shape] = value(number + 1, gone | {shape} if matters else gone)
        if number + 1 < problem.num_objects:
            reject *= problem.discount
        if (confirm[possible] == -1.0).all() and (reject[possible] == -1.0).all():
            return -1.0  # lost, whatever is done
        return bound_for(tuple(possible.tolist()))(belief, confirm, reject)

    return value
