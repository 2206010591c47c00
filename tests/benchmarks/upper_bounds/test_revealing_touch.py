"""Bounds by a touch that reveals the shape: above the optimal value, falling to it, and the mean of circumstances."""

import numpy as np
import pytest

from belief.errors import InvalidArgument
from belief.synthetic import random_model
from benchmarks.upper_bounds.revealing_touch import RevealingTouchBound
from benchmarks.upper_bounds.search import revealing_touch_bound
from benchmarks.upper_bounds.touch_costs import TouchCosts
from planners.solve import SearchTouchProblem, TouchProblem, solve


def table(seed, num_shapes=3, num_poses=2):
    return random_model(np.random.default_rng(seed), num_shapes=num_shapes, num_poses=num_poses).outcome_table().probs


@pytest.mark.parametrize("composition", ["distinct", "independent"])
@pytest.mark.parametrize("seed", range(3))
def test_of_a_search_it_is_above_what_plans_return_and_falls_with_every_touch(composition, seed):
    problem = SearchTouchProblem(table(seed), 3, composition, target=seed, touch_cost=0.05)
    bounds = [revealing_touch_bound(problem, touches) for touches in range(5)]
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[0] > bounds[3] + 1e-3
    achieved = solve(problem, rounds=(100, 100)).initial_value
    assert bounds[-1] >= achieved - 1e-9
    rivals = [revealing_touch_bound(problem, touches, names_rival=True) for touches in range(3)]
    assert rivals == sorted(rivals, reverse=True)
    assert all(tight < wide for tight, wide in zip(rivals, bounds, strict=False))
    assert achieved - 1e-9 <= rivals[-1] <= achieved + 0.05


def test_of_one_object_it_falls_to_the_optimal_value():
    probs, prior = table(0), np.full(3, 1 / 3)
    alone = solve(TouchProblem(probs, prior, 0, 0.1))
    bound = RevealingTouchBound([probs], TouchCosts(0.1), 6)
    confirm = np.array([1.0, -1.0, -1.0])
    assert alone.lower_bound - 1e-9 <= bound(prior, confirm, -confirm) <= alone.lower_bound + 0.01


def test_of_two_shapes_the_rival_is_known_and_no_touch_ahead_is_needed():
    probs = table(2, num_shapes=2)
    alone = solve(TouchProblem(probs, [0.4, 0.6], 0, 0.05))
    confirm = np.array([1.0, -1.0])
    bound = RevealingTouchBound([probs], TouchCosts(0.05), 0, names_rival=True)(np.array([0.4, 0.6]), confirm, -confirm)
    assert alone.lower_bound - 1e-9 <= bound <= alone.lower_bound + 0.002


def test_it_is_the_mean_over_circumstances_which_are_revealed():
    clear, blurred = np.eye(2)[None], np.full((1, 2, 2), 0.5)
    costs, belief, confirm = TouchCosts(0.1), np.array([0.7, 0.3]), np.array([1.0, -1.0])
    worlds = ([clear], [blurred], [clear, blurred])
    one, other, both = (RevealingTouchBound(some, costs, 2)(belief, confirm, -confirm) for some in worlds)
    assert one == pytest.approx(0.9)
    assert both == pytest.approx((one + other) / 2)
    mixed = RevealingTouchBound([(clear + blurred) / 2], costs, 2)(belief, confirm, -confirm)
    assert mixed <= both + 1e-12  # knowing the circumstances never hurts


def test_touches_that_show_nothing_with_some_probability_are_worth_less():
    costs = [TouchCosts(0.05, weights=weights) for weights in ((1.0,), (1.0, 0.5), (1.0, 0.0))]
    confirm, belief = np.array([1.0, -1.0, -1.0]), np.full(3, 1 / 3)
    bounds = [RevealingTouchBound([table(1)], some, 3)(belief, confirm, -confirm) for some in costs]
    assert bounds[0] > bounds[1] > bounds[2]


def test_too_many_sets_of_rejected_shapes_are_refused():
    problem = SearchTouchProblem(np.full((1, 30, 2), 0.5), 15, "distinct", target=0, touch_cost=0.05)
    with pytest.raises(InvalidArgument, match="30 shapes needs too many sets"):
        revealing_touch_bound(problem, 1)


def test_of_a_thousand_objects_it_is_a_bound_too():
    perfect = SearchTouchProblem(np.eye(2)[None], 1000, "independent", target=0, touch_cost=0.02)
    assert revealing_touch_bound(perfect, touches=1) == pytest.approx(1.0 - 2 * 0.02)  # every other object is a target
