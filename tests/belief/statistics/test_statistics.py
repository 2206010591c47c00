"""Intervals against their textbook formulas, their coverage, and McNemar's test against published values."""

from math import comb, exp, lgamma, log

import numpy as np
import pytest
from scipy import stats

from belief.statistics import (
    clopper_pearson_interval,
    cluster_bootstrap,
    mcnemar_test,
    paired_bootstrap,
    wilson_interval,
)


@pytest.mark.parametrize(("k", "n"), [(0, 1), (0, 50), (13, 50), (50, 50), (7, 10**6), (10**6, 10**6)])
def test_clopper_pearson_bounds_are_beta_quantiles(k, n):
    low, high = clopper_pearson_interval(k, n)
    assert low == pytest.approx(stats.beta.ppf(0.025, k, n - k + 1) if k else 0.0)
    assert high == pytest.approx(stats.beta.ppf(0.975, k + 1, n - k) if k < n else 1.0)


@pytest.mark.parametrize("interval", [wilson_interval, clopper_pearson_interval])
@pytest.mark.parametrize("confidence", [1 - 1e-16, 1 - 2e-16, 1e-300, 0.5, 0.999999])
@pytest.mark.parametrize(("successes", "trials"), [(0, 1), (3, 7), (7, 7), (10**15 - 1, 10**15)])
def test_intervals_hold_the_share_at_any_confidence(interval, confidence, successes, trials):
    low, high = interval(successes, trials, confidence)
    assert 0.0 <= low <= successes / trials + 1e-9
    assert successes / trials - 1e-9 <= high <= 1.0


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95, 0.99])
def test_wilson_intervals_are_those_of_scipy(confidence):
    for successes, trials in ((0, 5), (3, 7), (53, 100), (9, 9)):
        expected = stats.binomtest(successes, trials).proportion_ci(confidence, "wilson")
        assert wilson_interval(successes, trials, confidence) == (expected.low, expected.high)


def test_nearer_to_certainty_intervals_only_grow():
    widths = [np.ptp(wilson_interval(3, 7, 1 - 10.0**-k)) for k in range(1, 17)]
    assert (np.diff(widths) > 0.0).all()


@pytest.mark.parametrize("interval", [wilson_interval, clopper_pearson_interval])
@pytest.mark.parametrize(("k", "n"), [(0, 0), (1, 0), (-1, 5), (6, 5), (2.5, 5), (np.nan, 5), (1, np.inf), (1, 10**20)])
def test_impossible_counts_are_refused(interval, k, n):
    with pytest.raises(ValueError, match=f"got {k} of {n}"):
        interval(k, n)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95, -1.0, np.nan])
def test_a_confidence_is_no_percentage(confidence, rng):
    for estimate in (
        lambda: wilson_interval(1, 2, confidence),
        lambda: clopper_pearson_interval(1, 2, confidence),
        lambda: paired_bootstrap([1], [0], rng, confidence),
        lambda: cluster_bootstrap([1], [0], rng, confidence),
    ):
        with pytest.raises(ValueError, match=rf"confidence must be a number in \(0, 1\), got {confidence}"):
            estimate()


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


def test_a_bootstrap_of_blocks_is_that_of_all_at_once(rng, monkeypatch):
    first, second, groups = rng.normal(size=50), rng.normal(size=50), np.arange(50) // 3
    bootstraps = {
        "paired": lambda: paired_bootstrap(first, second, np.random.default_rng(1), num_resamples=101),
        "cluster": lambda: cluster_bootstrap(first, groups, np.random.default_rng(1), num_resamples=101),
    }
    at_once = {name: bootstrap() for name, bootstrap in bootstraps.items()}
    monkeypatch.setattr("belief.statistics.comparison._BLOCK", 120)
    assert {name: bootstrap() for name, bootstrap in bootstraps.items()} == at_once


@pytest.mark.parametrize(
    ("first", "second"),
    [([], []), ([1.0], [1.0, 2.0]), ([np.nan], [0.0]), ([np.inf], [np.inf]), ([1e308], [-1e308]), ([[1.0]], [[1.0]])],
)
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


@pytest.mark.parametrize("num_resamples", [0, -5, 2.5])
def test_resamples_are_counted(num_resamples, rng):
    for bootstrap in (paired_bootstrap, cluster_bootstrap):
        with pytest.raises(ValueError, match=f"num_resamples must be an integer, at least 1, got {num_resamples}"):
            bootstrap([1.0, 2.0], [0.0, 0.0], rng, num_resamples=num_resamples)


@pytest.mark.parametrize(
    ("both", "first_only", "second_only", "neither", "exact", "mid"),
    [
        # The examples of Fagerland, Lydersen and Laake (2013), data of Bentur et al. (2009) and Cavo et al. (2012),
        # with p-values by their formulas: for the first 2 (1 + 8) / 2⁸, and less 8 / 2⁸.
        (1, 1, 7, 12, 0.070, 0.039),
        (59, 6, 16, 80, 0.052, 0.035),
    ],
)
def test_mcnemar_gives_the_p_values_of_published_examples(both, first_only, second_only, neither, exact, mid):
    first = np.repeat([1, 1, 0, 0], [both, first_only, second_only, neither])
    second = np.repeat([1, 0, 1, 0], [both, first_only, second_only, neither])
    result = mcnemar_test(first, second)
    assert (result.num_episodes, result.first_only, result.second_only) == (len(first), first_only, second_only)
    assert result.difference == pytest.approx(first.mean() - second.mean())
    assert (round(result.p_value, 3), round(result.mid_p_value, 3)) == (exact, mid)


def test_mcnemar_counts_what_is_at_least_as_lopsided():
    for discordant in range(9):
        for first_only in range(discordant + 1):
            first = np.arange(discordant + 1) < first_only
            second = ~first & (np.arange(discordant + 1) < discordant)  # in the last episode both are wrong
            distance = np.abs(np.arange(discordant + 1) - discordant / 2)
            weights = np.array([comb(discordant, k) for k in range(discordant + 1)]) / 2**discordant
            more, equal = (distance > distance[first_only]), (distance == distance[first_only])
            result = mcnemar_test(first, second)
            assert result.p_value == pytest.approx(weights[more | equal].sum())
            mid_p_value = weights[more].sum() + weights[equal].sum() / 2 if discordant else 1.0
            assert result.mid_p_value == pytest.approx(mid_p_value)


@pytest.mark.parametrize("fewer", [1, 4, 17, 999_998])
def test_mcnemar_of_an_odd_number_that_is_nearly_even_is_exact_and_at_most_one(fewer):
    # P(at most k of 2k + 3) is one half less P(k + 1 of 2k + 3), of 2k + 1 it is one half.
    tosses = 2 * fewer + 3
    middle = exp(lgamma(tosses + 1) - lgamma(fewer + 2) - lgamma(fewer + 3) - tosses * log(2.0))
    for discordant, p_value in ((tosses - 2, 1.0), (tosses, 1.0 - 2.0 * middle)):
        first = np.arange(discordant) < fewer
        result = mcnemar_test(first, ~first)
        assert result.p_value == pytest.approx(p_value, rel=1e-9)
        assert max(result.p_value, result.mid_p_value) <= 1.0


def test_mcnemar_of_a_million_episodes_is_that_of_the_normal_law(rng):
    # With 200 000 discordant episodes the continuity-corrected normal law is right to a relative 1e-2 at three sigma.
    first = np.arange(1_000_000) < 100_671
    second = (np.arange(1_000_000) >= 100_671) & (np.arange(1_000_000) < 200_000)
    z = (100_671 - 99_329 - 1) / np.sqrt(200_000)
    assert mcnemar_test(first, second).p_value == pytest.approx(2 * stats.norm.sf(z), rel=1e-2)


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ([], [], "at least one"),
        ([[1]], [[1]], "one outcome per episode"),
        ([1, 0], [1], "same episodes"),
        ([1, 2], [1, 0], "got 2 in row 1"),
        ([1, 0], [0.5, 0], "second_correct must be right"),
        ([1, np.nan], [1, 0], "got nan in row 1"),
    ],
)
def test_outcomes_that_are_none_are_refused(first, second, message):
    with pytest.raises(ValueError, match=message):
        mcnemar_test(first, second)
