"""Upper bounds on the return of searches."""

from types import SimpleNamespace

import numpy as np
import pytest

from belief import SearchProblem
from benchmarks.search_bound import (
    RevealedBody,
    best_expected_return,
    best_return_with_revealed_bodies,
    revealed_body,
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
def test_where_planning_has_no_solution_there_is_no_bound():
    setting = Setting(touch_cost=0.0)
    assert best_expected_return(setting, 0) is None
    assert best_return_with_revealed_bodies(setting, 0) is None


@pytest.mark.torch
def test_twelve_shapes_have_a_bound_and_it_is_below_that_of_touches_which_reveal_the_shape():
    setting = Setting(SceneChoice("many"), observation_model="independent", num_objects=4)
    bound = best_expected_return(setting, 0)
    assert 0.5 < bound < one_touch_bound(setting.problem, 0) - 0.005
    assert best_return_with_revealed_bodies(setting, 0) is None  # its touches are independent given the shape


@pytest.mark.torch
def test_a_revealed_body_bounds_what_searches_return_and_is_below_touches_that_reveal_the_shape():
    setting = Setting(SceneChoice("coarse"))
    found = best_return_with_revealed_bodies(setting, 2)
    assert 0.918 < found.mean < one_touch_bound(setting.problem, 2) - 0.003  # searches return 0.920
    assert 0.0 < found.standard_error < 0.005
    assert RevealedBody.over_targets([[0.5, 0.1], [0.7, 0.1]]) == pytest.approx((0.6, 0.1))
    assert RevealedBody.over_targets([[0.5, 0.1], None]) is None


def test_bodies_are_revealed_in_groups_of_which_each_gives_a_bound(body, monkeypatch):
    asked, bounds = [], iter((0.1, 0.2, 0.3, 0.6))

    def bound(search, touches, tables):
        asked.append(tables)
        return next(bounds)

    monkeypatch.setattr("benchmarks.search_bound.revealing_touch_bound", bound)
    problem = SearchProblem(body.shape_labels, ("p", "q", "r"), num_objects=2, composition="independent")
    found = revealed_body(problem, body, 1)
    assert found.mean == pytest.approx(0.3)
    assert found.standard_error == pytest.approx(np.std([0.1, 0.2, 0.3, 0.6], ddof=1) / 2)
    spread = np.linspace(0, body.num_hypotheses - 1, 32).round().astype(int)  # from the first to the last
    assert len(asked) == 4
    for group, tables in enumerate(asked):
        assert len(tables) == 8
        for number, table in zip(spread[group::4], tables, strict=True):
            alone = body.outcome_probs(np.full((4, 1), number), 128)[:, :, 0]
            assert table.shape == (3, 4, alone.shape[2])
            np.testing.assert_allclose(table, alone, rtol=1e-4, atol=1e-7)
            np.testing.assert_allclose(table.sum(axis=2), 1.0, rtol=1e-12)


@pytest.mark.parametrize(("states", "most"), [(64, 3), (65, 2)])
def test_a_bound_takes_more_touches_as_long_as_they_lower_it(states, most, monkeypatch):
    setting = Setting(SceneChoice("many"))

    def found(values):
        tried = []
        monkeypatch.setattr(
            "benchmarks.search_bound.revealing_touch_bound",
            lambda search, touches, weights, names_rival: tried.append(touches) or values[touches - 1],
        )
        search = SimpleNamespace(num_states=states, num_shapes=12)
        monkeypatch.setattr("benchmarks.search_bound.discretised_search", lambda *_: (search, [1.0]))
        return best_expected_return(setting, 0), len(tried)

    assert found([0.9, 0.8, 0.7, 0.6]) == ((0.9, 0.8, 0.7)[most - 1], most)
    assert found([0.9, 0.8995, 0.5, 0.4]) == (0.8995, 2)


def test_few_states_and_shapes_have_the_bound_of_a_grid(monkeypatch):
    monkeypatch.setattr("benchmarks.search_bound.search_bound", lambda *_: "grid")
    monkeypatch.setattr("benchmarks.search_bound.revealing_touch_bound", lambda *_, **__: 0.5)
    for states, shapes, told in ((64, 6, "grid"), (65, 6, 0.5), (64, 7, 0.5)):
        search = SimpleNamespace(num_states=states, num_shapes=shapes)
        monkeypatch.setattr("benchmarks.search_bound.discretised_search", lambda *_, search=search: (search, [1.0]))
        assert best_expected_return(Setting(), 0) == told
