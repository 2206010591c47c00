"""Distributions have the probabilities and the limits that their names say."""

import numpy as np
import pytest
from scipy import stats

from activetouch.distributions import Constant, Distribution, LogUniform, Uniform

LAWS: list[tuple[Distribution, object]] = [
    (Uniform(1.0, 3.0), stats.uniform(1.0, 2.0)),
    (LogUniform(0.5, 8.0), stats.loguniform(0.5, 8.0)),
]


@pytest.mark.parametrize(("distribution", "law"), LAWS, ids=lambda part: repr(part)[:30])
def test_draws_follow_the_law_and_fill_its_support(distribution, law, rng):
    draws = [distribution.sample(rng) for _ in range(4000)]
    assert stats.kstest(draws, law.cdf).pvalue > 1e-4  # which a right sampler misses with this probability
    np.testing.assert_allclose(distribution.support, law.support())


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize(
    "make",
    [
        Constant,
        lambda x: Uniform(x, 1.0),
        lambda x: LogUniform(1.0, x),
    ],
)
def test_every_parameter_of_a_distribution_is_finite(make, bad):
    with pytest.raises(ValueError, match="must be a finite number"):
        make(bad)


def test_low_is_below_high_and_above_zero_where_logarithms_are_drawn():
    with pytest.raises(ValueError, match="low must not exceed high"):
        Uniform(2.0, 1.0)
    with pytest.raises(ValueError, match="low must be a finite number > 0"):
        LogUniform(0.0, 1.0)
