"""The bound for any sensor is the value of a search in which one touch reveals the shape."""

import numpy as np
import pytest

from belief import Counts, SearchProblem
from belief.seeding import sample_arrangement
from planners.solve import one_touch_bound, solve
from planners.touch_problem import SearchTouchProblem

SHAPES = ("sphere", "cube", "cone")


@pytest.mark.parametrize("cost", [0.02, 0.3, 0.5, 0.9])
@pytest.mark.parametrize(
    ("number", "composition"), [(1, "independent"), (2, "independent"), (2, "distinct"), (3, "distinct")]
)
def test_it_is_the_value_for_a_sensor_that_reveals_the_shape(number, composition, cost):
    perfect = SearchTouchProblem(np.eye(3)[None], number, composition, target=1, touch_cost=cost)
    problem = SearchProblem(SHAPES, ("front",), number, composition, touch_cost=cost)
    assert one_touch_bound(problem, "cube") == pytest.approx(solve(perfect).initial_value, abs=1e-6)


def test_where_touching_costs_more_than_an_error_it_is_the_best_guess():
    problem = SearchProblem(SHAPES, ("front",), 3, touch_cost=10.0)
    assert one_touch_bound(problem, 0) == pytest.approx(2.0 / 3.0 - 1.0)


def test_a_target_that_is_not_in_the_bag_needs_no_touch():
    problem = SearchProblem(SHAPES, ("front",), 2, Counts({"sphere": 1, "cube": 3}))
    assert one_touch_bound(problem, "cone") == 1.0


def test_free_touches_reveal_everything():
    problem = SearchProblem(SHAPES, ("front",), 3, "independent", touch_cost=0.0)
    assert one_touch_bound(problem, "cone") == pytest.approx(1.0)


def test_of_a_thousand_objects_it_is_a_bound_too():
    problem = SearchProblem(("a", "b"), ("front",), 1000, "independent", touch_cost=0.02)
    assert one_touch_bound(problem, "a") == pytest.approx(1.0 - 2 * 0.02)  # every other object is a target


@pytest.mark.parametrize("composition", ["distinct", "independent", Counts({"sphere": 1, "cube": 3})])
def test_with_strangers_a_searcher_that_sees_every_touched_object_does_not_exceed_it(composition):
    problem = SearchProblem(SHAPES, ("front",), 3, composition, unlisted=0.4)
    bound, rng = one_touch_bound(problem, "sphere"), np.random.default_rng(0)
    for most in range(4):  # touches, of the first objects in turn; then no target is claimed
        returns = []
        for _ in range(2000):
            objects = sample_arrangement(problem, rng)
            touched = objects[: most if 0 not in objects[:most] else objects.index(0) + 1]
            returns.append((1.0 if 0 in touched or 0 not in objects else -1.0) - 0.02 * len(touched))
        assert np.mean(returns) <= bound + 0.06
    assert bound <= 1.0
