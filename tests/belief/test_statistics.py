"""Intervals against their textbook formulas, and their coverage."""

import numpy as np
import pytest
from scipy import stats

from belief.statistics import clopper_pearson_interval, cluster_bootstrap, paired_bootstrap, wilson_interval


@pytest.mark.parametrize(("k", "n"), [(0, 1), (0, 50), (13, 50), (50, 50), (980, 1000)])
def test_wilson_interval_solves_its_quadratic(k, n):
    # The bounds are the p with |k/n - p| = z sqrt(p (1 - p) / n).
    z = stats.norm.ppf(0.975)
    for bound in wilson_interval(k, n):
        assert abs(k / n - bound) == pytest.approx(z * np.sqrt(bound * (1 - bound) / n), abs=1e-9)


@pytest.mark.parametrize(("k", "n"), [(0, 50), (13, 50), (50, 50)])
def test_clopper_pearson_bounds_are_beta_quantiles(k, n):
    low, high = clopper_pearson_interval(k, n)
    assert low == pytest.approx(stats.beta.ppf(0.025, k, n - k + 1) if k else 0.0)
    assert high == pytest.approx(stats.beta.ppf(0.975, k + 1, n - k) if k < n else 1.0)


@pytest.mark.parametrize(("k", "n"), [(1, 0), (-1, 5), (6, 5)])
def test_impossible_counts_are_refused(k, n):
    with pytest.raises(ValueError, match="successes"):
        wilson_interval(k, n)


def test_the_paired_bootstrap_covers_the_true_difference(rng):
    # 200 intervals at 95 %: fewer than 178 hits has probability below 1e-3.
    hits = 0
    for _ in range(200):
        common = rng.normal(size=60)
        first, second = common + 0.3 + 0.2 * rng.normal(size=60), common
        _, low, high = paired_bootstrap(first, second, rng, num_resamples=500)
        hits += low <= 0.3 <= high
    assert hits >= 178


def test_a_constant_difference_has_a_point_interval(rng):
    assert paired_bootstrap([1, 2, 3], [0, 1, 2], rng) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(("first", "second"), [([], []), ([1.0], [1.0, 2.0]), ([np.nan], [0.0])])
def test_pairs_that_do_not_match_are_refused(first, second, rng):
    with pytest.raises(ValueError, match=r"paired|non-empty"):
        paired_bootstrap(first, second, rng)


def test_the_cluster_bootstrap_covers_where_one_of_single_values_does_not(rng):
    # 40 clusters of 6 values that err together, 200 repetitions: the interval over clusters must cover the true mean in
    # at least 178 (probability of fewer below 1e-3 at a true coverage of .94); independent values would cover far less.
    truth, covered, naive = 0.5, 0, 0
    for _ in range(200):
        values = np.repeat(rng.normal(truth, 1.0, 40), 6) + 0.1 * rng.standard_normal(240)
        _, low, high = cluster_bootstrap(values, np.repeat(np.arange(40), 6), rng, num_resamples=400)
        covered += low <= truth <= high
        _, low, high = cluster_bootstrap(values, np.arange(240), rng, num_resamples=400)
        naive += low <= truth <= high
    assert covered >= 178
    assert naive < 150


def test_the_cluster_bootstrap_gives_the_plain_mean_and_takes_any_labels(rng):
    values, labels = [1.0, 0.0, 1.0, 1.0, 0.0], ["a", "a", "b", "b", "b"]
    mean, low, high = cluster_bootstrap(values, labels, rng)
    assert mean == pytest.approx(0.6)
    assert low == pytest.approx(0.5)
    assert high == pytest.approx(2 / 3)


@pytest.mark.parametrize(("values", "labels"), [([], []), ([1.0], [1, 2]), ([np.nan, 1.0], [0, 1]), ([[1.0]], [[1]])])
def test_the_cluster_bootstrap_refuses_what_has_no_mean(values, labels, rng):
    with pytest.raises(ValueError, match=r"as many clusters|finite"):
        cluster_bootstrap(values, labels, rng)
