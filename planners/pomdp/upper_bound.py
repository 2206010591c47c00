"""Upper bound on the value of a search: after a few touches of an object as its table has them, one more reveals it.

Until then the bound looks ahead exactly: all poses, all outcomes. Afterwards it takes the larger of stopping and of one
more touch that reveals the shape, which no touch exceeds. The shape of every rejected object is revealed too. So it is
an information relaxation: a searcher who learns more can only do better. It is valid for any number of exact touches
and falls with it. ``benchmarks/upper_bounds`` has tighter bounds, which take minutes.
"""

from __future__ import annotations

from functools import cache
from math import log

import numpy as np

from belief.composition import Composition
from belief.errors import InvalidArgument
from belief.validation import Floats
from planners.pomdp.problem import SearchTouchProblem, TouchProblem

_MOST_BRANCHES = 2_000_000  # of the exact look-ahead, which decide how many touches it has
_MOST_TOUCHES = 20
_MOST_SETS = 5000  # of distinct shapes that rejected objects can have
_PRECISION = 1e-6  # a branch that can change the bound by less is not followed
_AT_ONCE = 2_000_000  # numbers in the largest array


def upper_bound(problem: TouchProblem | SearchTouchProblem) -> float:
    """Upper bound on the optimal value at the start, in some seconds.

    Raises:
        InvalidArgument: distinct shapes of which too many sets can have been rejected.

    With one pose that is right nine times in ten, the optimal value is 0.8537:

    >>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])
    >>> round(upper_bound(TouchProblem(table, [0.5, 0.5], target=0, touch_cost=0.05)), 4)
    0.8537
    """
    confirm = np.where(np.arange(problem.num_shapes) == problem.target, 1.0, -1.0)
    if isinstance(problem, TouchProblem):
        return _of_object(problem, problem.prior, np.stack([confirm, -confirm]))
    distinct = problem.composition is Composition.DISTINCT
    if distinct and problem.num_states > _MOST_SETS * problem.num_shapes:
        raise InvalidArgument(
            f"a bound for {problem.num_objects} distinct objects of {problem.num_shapes} shapes needs too many sets of "
            f"rejected shapes, more than {_MOST_SETS}; ask for fewer shapes or objects"
        )

    @cache
    def value(number: int, gone: frozenset[int]) -> float:
        """Bound after so many rejected objects, by the set of their shapes that matter."""
        if number == problem.num_objects:
            return -1.0 if problem.target in gone else 1.0
        assert problem.prior is not None, "filled in at construction"
        left = np.isin(np.arange(problem.num_shapes), list(gone), invert=True)
        belief = left / left.sum() if distinct else problem.prior
        reject = np.full(problem.num_shapes, -1.0)
        for shape in np.flatnonzero(belief > 0.0).tolist():
            matters = distinct or shape == problem.target
            reject[shape] = value(number + 1, gone | {shape} if matters else gone)
        if number + 1 < problem.num_objects:
            reject *= problem.discount
        return _of_object(problem, belief, np.stack([confirm, reject]))

    if not distinct:  # there may be many objects: from the last one on, so that no recursion is deep
        for number in range(problem.num_objects - 1, 0, -1):
            value(number, frozenset())
            value(number, frozenset({problem.target}))
    return value(0, frozenset())


def _of_object(problem: TouchProblem | SearchTouchProblem, belief: Floats, payoffs: Floats) -> float:
    """Bound for one object at a belief ``(K,)``, with payoffs of CONFIRM and REJECT by shape ``(2, K)``."""
    shapes = np.flatnonzero(belief > 0.0)
    payoffs = payoffs[:, shapes]
    cost, discount = problem.touch_cost, problem.discount
    for_ever = -cost / (1.0 - discount) if discount < 1.0 else -np.inf  # touching without end postpones a failure
    known = np.maximum(payoffs.max(axis=0), for_ever)
    if len(shapes) == 1:
        return float(known[0])
    table = problem.outcome_probs[:, shapes].swapaxes(1, 2)  # (P, M, K)
    branches = max(table.shape[0] * table.shape[1], 2)
    touches = min(int(log(_MOST_BRANCHES) / log(branches)), _MOST_TOUCHES)

    def bound(beliefs: Floats, reach: Floats, left: int) -> Floats:
        """Bound at beliefs ``(B, k)`` that are reached with probabilities ``(B,)``, with so many exact touches left."""
        stop = np.maximum((beliefs @ payoffs.T).max(axis=1), for_ever)
        found = np.maximum(stop, discount * (beliefs @ known) - cost)
        matters = np.flatnonzero(reach * (found - stop) > _PRECISION)
        size = max(1, _AT_ONCE // table.size)
        for some in np.split(matters, range(size, len(matters), size)) if left and len(matters) else ():
            joint = beliefs[some, None, None] * table  # (b, P, M, k)
            chance = joint.sum(axis=3)
            after = (joint / np.maximum(chance, np.finfo(float).tiny)[..., None]).reshape(-1, len(shapes))
            reached = (reach[some, None, None] * chance).ravel()
            shown = (chance * bound(after, reached, left - 1).reshape(chance.shape)).sum(axis=2).max(axis=1)
            found[some] = np.minimum(found[some], np.maximum(stop[some], discount * shown - cost))
        return np.asarray(found)

    return float(bound(belief[None, shapes], np.ones(1), touches)[0])
