"""Extremes of the answer "I do not know"."""

import math

import pytest

from belief import SearchProblem, Unsure


@pytest.mark.parametrize("reward", [math.nan, math.inf, -1.1, 1.0])
def test_a_price_that_is_none_is_refused(reward):
    with pytest.raises(ValueError, match="unsure_reward"):
        SearchProblem(("a", "b"), ("p",), num_objects=1, unsure_reward=reward)


def test_answers_that_are_unsure_are_equal():
    assert Unsure() == Unsure()
