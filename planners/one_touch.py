"""Upper bound on the return of a search with any sensor: one touch reveals the shape of the object.

No sensor tells more about the shape than the shape itself, whatever its touches depend on: orientation, size, earlier
touches. So this bound holds for live searches, not only for a discretised sensor model. It is tight where touches are
informative, and loose where they are not. It is exact for the searches of the relaxed problem, by dynamic programming.
"""

from __future__ import annotations

import numpy as np

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
    shape, number = index_of("shape", problem.shape_labels, target), problem.num_objects
    bag = problem.bag_of(shape)
    unsure = -1.0 if problem.unsure_reward is None else problem.unsure_reward

    # The probability that an object is a target, by the number of others that touches have revealed.
    revealed = np.arange(number)
    if bag is None:
        probs = np.full(number, problem.prior_probs[shape])
    else:
        left = bag[1] - revealed
        probs = np.minimum(np.divide(bag[0], left, out=np.zeros(number), where=left > 0), 1.0)

    # The largest expected return once all objects are revealed or rejected untouched: no target is among the latter.
    absent = np.append(np.cumprod(1.0 - probs[::-1])[::-1], 1.0)
    if bag is not None:  # a stranger has taken its place; a touch that shows it tells as much as one of the target
        absent += (1.0 - absent) * problem.unlisted
    values = 2.0 * absent - 1.0
    for decided in range(number - 1, -1, -1):
        prob = probs[: decided + 1]
        touch = prob - problem.touch_cost + (1.0 - prob) * values[1 : decided + 2]
        values = np.maximum.reduce([touch, 2.0 * prob - 1.0, values[: decided + 1], np.full(decided + 1, unsure)])
    return float(values[0])
