"""Fronts against the definition, pair by pair."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belief.statistics import pareto_front


def front_by_pairs(costs, qualities):
    def dominates(j, i):
        as_good = costs[j] <= costs[i] and qualities[j] >= qualities[i]
        return as_good and (costs[j] < costs[i] or qualities[j] > qualities[i])

    return [not any(dominates(j, i) for j in range(len(costs))) for i in range(len(costs))]


points = st.lists(st.tuples(st.integers(-2, 3), st.integers(-2, 3)), min_size=1, max_size=9)


@given(points)
def test_the_front_is_what_no_other_dominates(configurations):
    costs, qualities = zip(*configurations, strict=True)
    assert pareto_front(costs, qualities).tolist() == front_by_pairs(costs, qualities)


def test_equal_configurations_do_not_dominate_each_other():
    assert pareto_front([1.0, 1.0, 1.0], [0.5, 0.5, 0.4]).tolist() == [True, True, False]


def test_the_only_configuration_is_the_front():
    assert pareto_front([3.0], [-1.0]).tolist() == [True]


@pytest.mark.parametrize(
    ("costs", "qualities", "message"),
    [
        (np.zeros((1, 0)), np.zeros((1, 0)), "at least one configuration"),
        (np.zeros((1, 2)), np.zeros((1, 3)), "at least one configuration"),
        (1.0, 1.0, "at least one configuration"),
        ([[1.0, np.nan]], [[1.0, 2.0]], r"costs must be finite .* got nan at \[0, 1\]"),
        ([[1.0, 2.0]], [[1.0, np.inf]], r"qualities must be finite .* got inf at \[0, 1\]"),
        ([[1.0, 2.0]], [[1.0, 1e308]], "qualities must be finite"),
    ],
)
def test_what_has_no_front_is_refused(costs, qualities, message):
    with pytest.raises(ValueError, match=message):
        pareto_front(costs, qualities)
