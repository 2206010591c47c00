"""What no decider exceeds."""

from types import SimpleNamespace

import numpy as np
import pytest

from belief import SearchProblem
from experiments.scene_choice import SceneChoice
from experiments.search import oracle
from experiments.search.bound import (
    RevealedBody,
    best_expected_return,
    best_return_with_revealed_bodies,
    revealed_body,
)
from experiments.search.oracle import solved_by_full_information
from experiments.search.setting import Setting, load_sensor, make_world
from experiments.search.touch_memo import TouchMemo
from planners.bounds.one_touch import one_touch_bound
from planners.search import TouchRequest
from planners.solve import TouchProblem, solve


@pytest.mark.torch
def test_of_a_search_among_one_object_the_bound_is_that_of_planning_for_one_object():
    setting = Setting(num_objects=1, touch_cost=0.1)
    table = load_sensor(setting).model.outcome_table(24).probs  # as many outcomes as the bound has
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

    monkeypatch.setattr("experiments.search.bound.revealing_touch_bound", bound)
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
            "experiments.search.bound.revealing_touch_bound",
            lambda search, touches, weights, names_rival: tried.append(touches) or values[touches - 1],
        )
        search = SimpleNamespace(num_states=states, num_shapes=12)
        monkeypatch.setattr("experiments.search.bound.discretised_search", lambda *_: (search, [1.0]))
        return best_expected_return(setting, 0), len(tried)

    assert found([0.9, 0.8, 0.7, 0.6]) == ((0.9, 0.8, 0.7)[most - 1], most)
    assert found([0.9, 0.8995, 0.5, 0.4]) == (0.8995, 2)


def test_few_states_and_shapes_have_the_bound_of_a_grid(monkeypatch):
    monkeypatch.setattr("experiments.search.bound.search_bound", lambda *_: "grid")
    monkeypatch.setattr("experiments.search.bound.revealing_touch_bound", lambda *_, **__: 0.5)
    for states, shapes, told in ((64, 6, "grid"), (65, 6, 0.5), (64, 7, 0.5)):
        search = SimpleNamespace(num_states=states, num_shapes=shapes)
        monkeypatch.setattr("experiments.search.bound.discretised_search", lambda *_, search=search: (search, [1.0]))
        assert best_expected_return(Setting(), 0) == told


@pytest.mark.torch
@pytest.mark.mujoco
def test_which_episodes_full_information_solves_does_not_depend_on_which_are_asked_for():
    coarse = Setting(SceneChoice(scene="coarse"))
    some, all_of_them = (solved_by_full_information(coarse, 0, 5, numbers) for numbers in ([2, 3], [0, 1, 2, 3]))
    assert all_of_them[2:] == some


@pytest.mark.torch
@pytest.mark.mujoco
def test_the_oracle_gives_the_most_probable_answer_also_where_the_target_is_absent():
    """Objects of independent shapes have independent posteriors, so its rule can be written down."""
    setting = Setting(
        SceneChoice("coarse", fidelity="quasistatic"), num_objects=2, composition="independent", anyway=True
    )
    sensor, expected, absent = load_sensor(setting), [], []
    for number in range(24):
        world = make_world(setting, sensor, (5, 1, number))
        probs = []
        for index in range(2):
            if index:
                world.advance()
            requests = [TouchRequest.of(world, (5, 1, number), index, pose, repeat=0) for pose in range(6)]
            images = np.stack([TouchMemo().press(request)[0] for request in requests])
            logs = sensor.model.log_likelihood(sensor.read(images, list(range(6))))
            probs.append(np.exp(logs[1] - np.logaddexp.reduce(logs)))
        is_absent = np.prod(1.0 - np.array(probs)) > max(probs)
        absent.append(1 not in world.arrangement)
        expected.append(absent[-1] if is_absent else world.arrangement[int(np.argmax(probs))] == 1)
    assert 4 < sum(absent) < 20
    assert solved_by_full_information(setting, 1, 5, range(24)) == expected
    assert sum(expected) >= 22


@pytest.mark.torch
@pytest.mark.mujoco
def test_the_oracle_that_answers_when_certain_answers_as_if_it_had_touched_every_pose(monkeypatch):
    coarse, memo, every = Setting(SceneChoice(scene="coarse")), TouchMemo(), TouchMemo()
    early = solved_by_full_information(coarse, 2, 5, range(8), memo)
    monkeypatch.setattr(oracle, "_CERTAIN", 2.0)  # never
    assert solved_by_full_information(coarse, 2, 5, range(8), every) == early
    assert 0 < memo.num_kept < every.num_kept == 8 * 4 * 6  # episodes, objects, poses
