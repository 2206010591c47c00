"""Upper bounds on the return of searches."""

import pytest

from benchmarks.search_bound import (
    best_expected_return,
    best_return_with_revealed_bodies,
)
from experiments.scene_choice import SceneChoice
from experiments.search.setting import Setting
from planners.one_touch import one_touch_bound
from planners.solve import TouchProblem, solve


@pytest.mark.torch
def test_of_a_search_among_one_object_the_bound_is_that_of_planning_for_one_object():
    setting = Setting(num_objects=1, touch_cost=0.1)
    table = setting.open_sensor().model.outcome_table(24).probs  # as many outcomes as the bound has
    alone = solve(TouchProblem(table, [0.25] * 4, target=3, touch_cost=0.1))
    assert alone.lower_bound - 1e-9 <= best_expected_return(setting, 3) <= alone.upper_bound + 0.01


@pytest.mark.torch
def test_twelve_shapes_have_a_bound_and_it_is_below_that_of_touches_which_reveal_the_shape():
    setting = Setting(SceneChoice("many"), observation_model="independent", num_objects=4)
    bound = best_expected_return(setting, 0)
    assert 0.5 < bound < one_touch_bound(setting.problem, 0) - 0.005
    assert best_return_with_revealed_bodies(setting, 0) is None  # its touches are independent given the shape
