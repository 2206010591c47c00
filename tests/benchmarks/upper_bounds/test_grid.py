"""Bounds on grids of beliefs: what the solver reaches is hardly below, and what brute force finds never above."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import softmax

from belief.errors import InvalidArgument
from benchmarks.upper_bounds.belief_grid import BeliefGrid
from benchmarks.upper_bounds.object import ObjectBound, object_bound
from benchmarks.upper_bounds.search import search_bound
from benchmarks.upper_bounds.simplex import SimplexGrid
from benchmarks.upper_bounds.touch_costs import TouchCosts
from planners.pomdp.upper_bound import upper_bound
from planners.solve import SearchTouchProblem, TouchProblem, finite_horizon_value, solve


def random_table(seed, num_poses=3, num_shapes=3, num_outcomes=4, sharpness=1.5):
    scores = np.random.default_rng(seed).normal(size=(num_poses, num_shapes, num_outcomes))
    return softmax(sharpness * scores, axis=2)


def uniform(table, target=0, touch_cost=0.05, **options):
    num_shapes = table.shape[1]
    return TouchProblem(table, np.full(num_shapes, 1 / num_shapes), target, touch_cost, **options)


def arrangements_of(problem):
    shapes = range(problem.num_shapes)
    if problem.composition == "distinct":
        rows = np.array(list(itertools.permutations(shapes, problem.num_objects)))
        return rows, np.full(len(rows), 1 / len(rows))
    rows = np.array(list(itertools.product(shapes, repeat=problem.num_objects)))
    return rows, problem.prior[rows].prod(axis=1)


@settings(max_examples=3)
@given(st.integers(0, 10_000), st.sampled_from([0.01, 0.03, 0.1]))
def test_dearer_touches_are_never_worth_more(seed, touch_cost):
    table = random_table(seed, 2, 3, 3)
    rng = np.random.default_rng(seed)
    cheap, dear = (object_bound(uniform(table, touch_cost=c), rng) for c in (touch_cost, 2 * touch_cost))
    assert solve(uniform(table, touch_cost=2 * touch_cost), rounds=(100, 100)).lower_bound <= cheap + 1e-9
    assert dear <= cheap + 1e-6


def value_of_touches_that_may_show_nothing(problem, arrangements, weights, number, touches, shown):
    """Value of a search in which an object's t-th touch shows an outcome with probability shown[t], else nothing."""
    if number == problem.num_objects:
        present = (arrangements == problem.target).any(axis=1)
        return float(weights @ np.where(present, -1.0, 1.0))
    shapes = arrangements[:, number]
    best = float(weights @ np.where(shapes == problem.target, 1.0, -1.0))
    best = max(best, value_of_touches_that_may_show_nothing(problem, arrangements, weights, number + 1, 0, shown))
    if touches < len(shown):
        after = (number, touches + 1, shown)
        nothing = value_of_touches_that_may_show_nothing(problem, arrangements, weights, *after)
        for table in problem.outcome_probs:
            worth = sum(
                value_of_touches_that_may_show_nothing(problem, arrangements, weights * column[shapes], *after)
                for column in table.T
            )
            worth = shown[touches] * worth + (1.0 - shown[touches]) * nothing
            best = max(best, worth - problem.touch_cost * weights.sum())
    return best


@pytest.mark.parametrize("composition", ["distinct", "independent"])
@pytest.mark.parametrize(("num_objects", "num_shapes"), [(1, 2), (1, 4), (2, 3)])
def test_bounds_for_touches_that_repeat_each_other_are_those_of_brute_force(composition, num_objects, num_shapes):
    table = random_table(num_shapes, 2, num_shapes, 2, sharpness=2.5)
    problem = SearchTouchProblem(table, num_objects, composition, 0, 0.04)
    rows, weights = arrangements_of(problem)
    expected = value_of_touches_that_may_show_nothing(problem, rows, weights, 0, 0, (0.9, 0.4))
    found = search_bound(problem, np.random.default_rng(0), (0.9, 0.4, 0.0))
    assert expected - 1e-9 <= found <= expected + 0.03
    fresh = search_bound(problem, np.random.default_rng(0))
    assert found <= fresh + 1e-9


def test_touching_for_ever_counts_where_later_touches_show_nothing():
    """Both answers fail more often than not, and touches only put that off, for 0.001 / (1 - 0.9) in all."""
    costs = TouchCosts(0.001, 0.9, (1.0, 0.0))
    bound = ObjectBound(np.full((1, 2, 2), 0.5), np.arange(2), costs, np.random.default_rng(0))
    payoffs = np.array([1.0, -1.0]), np.array([-1.0, -1.0])
    assert bound(np.array([0.25, 0.75]), *payoffs) >= costs.for_ever - 1e-9


def test_an_outcome_that_nearly_never_comes_costs_nearly_without_limit():
    assert TouchCosts(0.02, 1.0, (1.0, 1e-17)).lasting == pytest.approx((2e15, 1.0))


def test_where_an_outcome_lasts_as_rarely_it_costs_as_much_more():
    table = random_table(1, 2, 3, 3)
    rare = ObjectBound(table, np.arange(3), TouchCosts(0.02, 1.0, (0.25,)), np.random.default_rng(0))
    dear = ObjectBound(table, np.arange(3), TouchCosts(0.08), np.random.default_rng(0))
    arguments = np.full(3, 1 / 3), np.array([1.0, -1.0, -1.0]), np.array([-1.0, 1.0, 1.0])
    assert rare(*arguments) == pytest.approx(dear(*arguments), abs=2e-4)


@pytest.mark.parametrize("weights", [(1.0,), (1.0, 0.5, 0.25), (0.5, 0.5)])
def test_costs_after_some_touches_have_the_weights_that_follow(weights):
    costs = TouchCosts(0.1, 0.9, weights)
    for touches, more in itertools.product(range(5), range(5)):
        assert (
            costs.after(touches).weight(more)
            == costs.weight(touches + more)
            == [*weights, *[weights[-1]] * 9][touches + more]
        )


@pytest.mark.parametrize("numbers", [(np.inf, 1.0), (np.nan, 1.0), (-0.1, 1.0), (0.1, 0.0), (0.1, 1.1), (0.1, np.nan)])
def test_what_is_no_cost_or_discount_is_refused(numbers):
    with pytest.raises(InvalidArgument, match="finite cost ≥ 0 and a discount"):
        TouchCosts(*numbers)


@pytest.mark.parametrize("weights", [(), (0.5, 0.6), (1.1,), (0.5, -0.1), (np.nan,)])
def test_what_is_no_worth_of_touches_is_refused(weights):
    with pytest.raises(ValueError, match="weights"):
        TouchCosts(0.1, 1.0, weights)


@settings(max_examples=8)
@given(st.integers(2, 6), st.integers(0, 1000))
def test_interpolation_returns_the_belief_itself(num_shapes, seed):
    rng = np.random.default_rng(seed)
    beliefs = rng.dirichlet(np.full(num_shapes, 0.5), size=50)
    beliefs[0] = np.eye(num_shapes)[0]
    grid = BeliefGrid(np.full((1, num_shapes, 1), 1.0), beliefs[:20])
    for shape in range(num_shapes):  # exact for linear functions
        assert grid.interpolate(grid.points[:, shape], beliefs) == pytest.approx(beliefs[:, shape], abs=1e-9)
    convex = (grid.points**2).sum(axis=1)
    assert (grid.interpolate(convex, beliefs) >= (beliefs**2).sum(axis=1) - 1e-9).all()


@pytest.mark.parametrize("num_parts", [3, 17, 45])
def test_points_of_a_grid_of_many_parts_are_told_apart(num_parts):
    # Numbers for points of more than some forty parts do not fit 64 bits.
    grid, rng = SimplexGrid(num_parts, [2], np.empty((0, num_parts))), np.random.default_rng(0)
    assert len(grid.points) == num_parts * (num_parts + 1) // 2
    columns, weights = grid.look_up(grid.points)
    assert (np.take_along_axis(columns, weights.argmax(axis=1)[:, None], axis=1)[:, 0] == np.arange(len(columns))).all()
    some = rng.dirichlet(np.full(num_parts, 0.3), size=20)
    columns, weights = grid.look_up(some)
    np.testing.assert_allclose((weights[:, :, None] * grid.points[columns]).sum(axis=1), some, atol=1e-12)


def test_a_table_too_large_for_any_grid_is_refused_by_a_stated_limit(monkeypatch):
    monkeypatch.setattr("benchmarks.upper_bounds.belief_grid._MOST_NUMBERS", 1000)
    with pytest.raises(InvalidArgument, match=r"1 poses, 2 shapes and 2 outcomes needs .* more than 1000"):
        object_bound(TouchProblem([[[0.9, 0.1], [0.1, 0.9]]], [0.5, 0.5], 0, 0.05), np.random.default_rng(0))


def test_a_grid_beyond_the_limit_is_coarser_and_still_bounds(monkeypatch):
    table = np.random.default_rng(0).dirichlet(np.full(3, 0.5), size=(2, 4))
    problem = TouchProblem(table, np.full(4, 0.25), 0, 0.05)
    fine = object_bound(problem, np.random.default_rng(0))
    monkeypatch.setattr("benchmarks.upper_bounds.belief_grid._MOST_NUMBERS", 6000 * table.size)
    coarse = object_bound(problem, np.random.default_rng(0))
    assert solve(problem, rounds=(50, 50)).lower_bound <= coarse
    assert fine <= coarse + 1e-6 <= fine + 0.01


@pytest.mark.parametrize("num_shapes", [2, 3, 4])
@pytest.mark.parametrize("touch_cost", [0.02, 0.1])
def test_the_solver_reaches_nearly_the_bound(num_shapes, touch_cost):
    problem = uniform(random_table(num_shapes, 3, num_shapes, 3), target=1, touch_cost=touch_cost)
    tight, reached = object_bound(problem, np.random.default_rng(0)), solve(problem).lower_bound
    assert finite_horizon_value(problem, 4) <= tight + 1e-9
    assert 0.997 * tight <= reached <= tight + 1e-9
    assert tight <= upper_bound(problem) + 1e-4


@pytest.mark.parametrize("composition", ["distinct", "independent"])
@pytest.mark.parametrize(("discount", "touch_cost"), [(1.0, 0.15), (0.9, 0.01), (0.5, 0.05)])
def test_no_policy_of_a_search_exceeds_its_bound(composition, discount, touch_cost):
    problem = SearchTouchProblem(
        random_table(1, 1, 3, 2, sharpness=0.5), 2, composition, 1, touch_cost, discount=discount
    )
    tight = search_bound(problem, np.random.default_rng(0))
    assert solve(problem, rounds=(60, 60)).initial_value <= tight + 1e-6
    assert tight <= upper_bound(problem) + 1e-4
