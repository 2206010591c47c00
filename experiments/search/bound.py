"""An upper bound on the return of a comparison's searches, for the discretised sensor model.

The bound counts what touches cost: :mod:`planners.solve` certifies what no policy's expected return exceeds if a touch
is a draw from the outcome table, and a pose's second and third touch are worth what the observation model says of
repeats, for policies that use no pose again before the others. Live touches hold more than their outcome does, and are
not independent given the shape, so live returns can exceed the bound.
"""

from __future__ import annotations

import numpy as np

from belief import Composition
from experiments.search.setting import Setting, load_sensor
from planners.bounds.search import search_bound
from planners.repeats import repeat_discount, weights_in_turn
from planners.solve import SearchTouchProblem

_MOST_STATES = 64  # four distinct objects have 32, and take some minutes
_LEAST_OUTCOMES = 24  # of a touch: fewer would hold less than deciders make of it
_MOST_USES = 4  # of a pose that are priced one by one; the last price holds for all that follow


def best_expected_return(setting: Setting, target: int) -> float | None:
    """Upper bound on the expected return of a search for a target, for the discretised sensor model.

    In it touches are independent given the shape; live touches are not. None where it cannot be solved.
    """
    problem, model = setting.problem, load_sensor(setting).model
    if not isinstance(problem.composition, Composition) or problem.touch_cost == 0.0:
        return None
    probs = model.outcome_table(max(_LEAST_OUTCOMES, model.default_outcomes)).probs
    search = SearchTouchProblem(probs, problem.num_objects, problem.composition, target, problem.touch_cost)
    if search.num_states > _MOST_STATES:
        return None
    weights = weights_in_turn(repeat_discount(model), problem.num_poses, _MOST_USES)
    return search_bound(search, np.random.default_rng(0), weights.tolist())
