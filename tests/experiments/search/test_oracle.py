"""What no decider exceeds."""

import pytest

from experiments.scene_choice import SceneChoice
from experiments.search.bound import best_expected_return
from experiments.search.oracle import solved_by_full_information
from experiments.search.setting import Setting, load_sensor
from planners.solve import TouchProblem, solve


@pytest.mark.torch
def test_of_a_search_among_one_object_the_bound_is_that_of_planning_for_one_object():
    setting = Setting(num_objects=1, touch_cost=0.1)
    table = load_sensor(setting).model.outcome_table().probs
    alone = solve(TouchProblem(table, [0.25] * 4, target=3, touch_cost=0.1))
    assert alone.lower_bound - 1e-9 <= best_expected_return(setting, 3) <= alone.upper_bound + 0.01


@pytest.mark.torch
@pytest.mark.parametrize("setting", [Setting(touch_cost=0.0), Setting(SceneChoice(scene="many"))])
def test_where_planning_has_no_solution_or_takes_too_long_there_is_no_bound(setting):
    assert best_expected_return(setting, 0) is None


@pytest.mark.torch
@pytest.mark.mujoco
def test_which_episodes_full_information_solves_does_not_depend_on_which_are_asked_for():
    coarse = Setting(SceneChoice(scene="coarse"))
    some, all_of_them = (solved_by_full_information(coarse, 0, 5, numbers) for numbers in ([2, 3], [0, 1, 2, 3]))
    assert all_of_them[2:] == some
