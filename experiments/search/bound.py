"""Upper bound on the expected return of a comparison's searches, for the discretised sensor model.

In this model a touch is a draw from the outcome table, and repeats of a pose are discounted as the observation model
says. The bound holds for policies that use every pose before they repeat one (:mod:`planners.solve`). Live touches
carry more information than their outcome and are correlated, so live returns can exceed the bound.
"""

from __future__ import annotations

import numpy as np

from belief import Composition
from experiments.search.setting import Setting, load_sensor
from planners.bounds.search import search_bound
from planners.repeats import repeat_discount, weights_in_turn
from planners.solve import SearchTouchProblem

_MOST_STATES = 64  # four distinct objects have 32, which takes minutes
_LEAST_OUTCOMES = 24  # of the outcome table; fewer would lose information that deciders use
_MOST_USES = 4  # of a pose with a discount of their own; later uses have the last discount


def best_expected_return(setting: Setting, target: int) -> float | None:
    """Upper bound on the expected return of a search for a target; None if the search is too large to solve."""
    problem, model = setting.problem, load_sensor(setting).model
    if not isinstance(problem.composition, Composition) or problem.touch_cost == 0.0:
        return None
    probs = model.outcome_table(max(_LEAST_OUTCOMES, model.default_outcomes)).probs
    search = SearchTouchProblem(probs, problem.num_objects, problem.composition, target, problem.touch_cost)
    if search.num_states > _MOST_STATES:
        return None
    weights = weights_in_turn(repeat_discount(model), problem.num_poses, _MOST_USES)
    return search_bound(search, np.random.default_rng(0), weights.tolist())
