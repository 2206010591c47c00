"""Extremes of answers that are withheld: Unsure, risk_coverage and its RiskCoverage."""

import math

import numpy as np
import pytest

from belief import SearchProblem, Unsure
from belief.metrics import RiskCoverage, risk_coverage


@pytest.mark.parametrize("trust", [[1e150, 0.0, -1e150], [5e-324, 0.0, -5e-324], np.float16([1.0, 0.5, 0.25])])
def test_scores_of_any_magnitude_give_a_finite_curve(trust, rng):
    curve = risk_coverage(trust, [True, True, False], rng, num_unanswered=10**6, num_resamples=20)
    assert isinstance(curve, RiskCoverage)
    np.testing.assert_allclose(curve.risk, [0.0, 0.0, 1 / 3])
    assert 0.0 < curve.coverage[0] < 1e-5


@pytest.mark.parametrize("bad", [[math.nan], [math.inf], []])
def test_scores_that_are_no_numbers_are_refused(bad, rng):
    with pytest.raises(ValueError, match=r"trust|correct"):
        risk_coverage(bad, [True] * len(bad), rng)


@pytest.mark.parametrize("reward", [math.nan, math.inf, -1.1, 1.0])
def test_a_price_that_is_none_is_refused(reward):
    with pytest.raises(ValueError, match="unsure_reward"):
        SearchProblem(("a", "b"), ("p",), num_objects=1, unsure_reward=reward)


def test_answers_that_are_unsure_are_equal():
    assert Unsure() == Unsure()
