"""Bounds by a touch that reveals the shape: above the optimal value, falling to it, and the mean of circumstances."""

import numpy as np
import pytest

from belief.synthetic import random_model
from benchmarks.upper_bounds.revealing_touch import RevealingTouchBound
from benchmarks.upper_bounds.search import revealing_touch_bound
from benchmarks.upper_bounds.touch_costs import TouchCosts
from planners.solve import SearchTouchProblem, solve


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


def test_it_is_the_mean_over_circumstances_which_are_revealed():
    clear, blurred = np.eye(2)[None], np.full((1, 2, 2), 0.5)
    costs, belief, confirm = TouchCosts(0.1), np.array([0.7, 0.3]), np.array([1.0, -1.0])
    worlds = ([clear], [blurred], [clear, blurred])
    one, other, both = (RevealingTouchBound(some, costs, 2)(belief, confirm, -confirm) for some in worlds)
    assert one == pytest.approx(0.9)
    assert both == pytest.approx((one + other) / 2)
    mixed = RevealingTouchBound([(clear + blurred) / 2], costs, 2)(belief, confirm, -confirm)
    assert mixed <= both + 1e-12  # knowing the circumstances never hurts
