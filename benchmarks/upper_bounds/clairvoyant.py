"""Upper bound on the value of a search in which the shape of every rejected object is revealed.

This is an information relaxation: a searcher who learns more can only do better.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TypeAlias

import numpy as np

from belief.composition import Composition
from belief.validation import Floats
from planners.pomdp.problem import SearchTouchProblem

from .touch_costs import TouchCosts

BoundOfObject: TypeAlias = Callable[[Floats, Floats, Floats], float]
"""Upper bound on the value for one object at a belief, for payoffs of CONFIRM and REJECT by shape, all ``(K,)``."""


def clairvoyant_bound(
    problem: SearchTouchProblem, bound_for: Callable[[tuple[int, ...]], BoundOfObject]
) -> Callable[[int, frozenset[int]], float]:
    """Upper bound by the number of rejected objects and the set of their shapes that matter.

    The searcher's belief is about the current object only, so every stage is a problem of one object; the last stage is
    solved first. All rejected shapes matter if shapes are distinct; otherwise only whether the target was among them.
    ``bound_for`` gives the bound for one object by its possible shapes.
    """
    num_shapes, target, prior = problem.num_shapes, problem.target, problem.prior
    assert prior is not None, "filled in at construction"
    confirm = np.where(np.arange(num_shapes) == target, 1.0, -1.0)
    distinct = problem.composition is Composition.DISTINCT
    for_ever = TouchCosts(problem.touch_cost, problem.discount).for_ever

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
            return max(-1.0, for_ever)  # no action can succeed
        return bound_for(tuple(possible.tolist()))(belief, confirm, reject)

    if not distinct:  # there may be many objects: from the last one on, so that no recursion is deep
        for number in range(problem.num_objects - 1, 0, -1):
            for shape in np.flatnonzero(prior > 0.0).tolist():
                value(number, frozenset({target} if shape == target else ()))
    return value
