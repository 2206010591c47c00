"""Upper bound on the return of a search with any sensor: one touch reveals the shape of the object.

No sensor tells more about the shape than the shape itself, whatever its touches depend on: orientation, size, earlier
touches. So this bound holds for live searches, not only for a discretised sensor model. It is tight where touches are
informative, and loose where they are not. It is exact for the searches of the relaxed problem, by dynamic programming.
"""

from __future__ import annotations

from functools import cache

from belief.naming import Name, index_of
from belief.problem import SearchProblem


def one_touch_bound(problem: SearchProblem, target: Name) -> float:
    """The largest expected return of any decider with any sensor, if each touch costs the problem's touch cost.

    Args:
        problem: the search.
        target: label or index of the shape sought.

    Raises:
        UnknownName: no shape has the target's name.
        ValueError: a target out of range.

    Four objects of four shapes: 1, 2, 3 or 3 touches, because the last object needs none.

    >>> problem = SearchProblem(("sphere", "cube", "cylinder", "cone"), ("front",), num_objects=4)
    >>> round(one_touch_bound(problem, "cone"), 4)            # 1 - 0.02 · 9 / 4
    0.955
    """
    shape, cost = index_of("shape", problem.shape_labels, target), problem.touch_cost
    counts = problem.counts
    unsure = -1.0 if problem.unsure_reward is None else problem.unsure_reward

    def target_prob(others: int) -> float:
        """Probability that an object is a target, after so many were revealed to be others."""
        if counts is None:
            return float(problem.prior_probs[shape])
        left = sum(counts) - others
        return min(counts[shape] / left, 1.0) if left else 0.0

    def absent_prob(others: int, unknown: int) -> float:
        """Probability that no target is among objects that were rejected untouched."""
        prob = 1.0
        for number in range(unknown):
            prob *= 1.0 - target_prob(others + number)
        return prob

    @cache
    def value(others: int, unknown: int) -> float:
        """Largest expected return after ``others`` were revealed not to be targets and ``unknown`` rejected."""
        if others + unknown == problem.num_objects:
            return 2.0 * absent_prob(others, unknown) - 1.0
        prob = target_prob(others)
        touch = prob - cost + ((1.0 - prob) * value(others + 1, unknown) if prob < 1.0 else 0.0)
        return max(touch, 2.0 * prob - 1.0, value(others, unknown + 1), unsure)

    for decided in range(problem.num_objects, 0, -1):  # from the last object on, so that no recursion is deep
        for others in range(decided + 1):
            value(others, decided - others)
    return value(0, 0)
