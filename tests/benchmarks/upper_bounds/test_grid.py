"""Bounds on grids of beliefs: what the solver reaches is hardly below, and what brute force finds never above."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import softmax

from benchmarks.upper_bounds.belief_grid import BeliefGrid
from benchmarks.upper_bounds.object import object_bound
from benchmarks.upper_bounds.search import search_bound
from planners.pomdp.policy import upper_bound
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
