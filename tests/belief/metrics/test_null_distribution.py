"""What chance does to calibration errors: against exact distributions, and by the coverage of intervals."""

from functools import partial

import numpy as np
import pytest
from scipy import stats

from belief.metrics import (
    bias_corrected_interval,
    classwise_calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
    null_quantile,
    smooth_calibration_error,
)
from belief.metrics.chance import drawn_labels


def draw(rng, n, sharpening):
    """Predictions over-confident by the sharpening, and labels."""
    logits = 2.5 * rng.normal(size=(n, 4))
    true_probs = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    labels = (rng.random(n)[:, None] >= true_probs.cumsum(axis=1)[:, :-1]).sum(axis=1)
    probs = np.exp(sharpening * logits)
    return probs / probs.sum(axis=1, keepdims=True), labels


@pytest.mark.parametrize("quantile", [0.5, 0.95])
def test_the_null_quantile_is_that_of_the_exact_distribution(quantile, rng):
    # Fifty rows at .7, one bin: |.7 - k/50| with k binomial. A quantile of 4 000 draws lies between the exact ones at
    # ∓ .02 but with probability 1e-2 (of .5) and 1e-8 (of .95); the values are discrete, which makes it less.
    k = np.arange(51)
    gaps, weights = np.abs(0.7 - k / 50), stats.binom.pmf(k, 50, 0.7)
    order = np.argsort(gaps)
    cumulative = weights[order].cumsum()
    exact = [gaps[order][np.searchsorted(cumulative, q)] for q in (quantile - 0.02, quantile + 0.02)]
    probs = np.tile([0.7, 0.3], (50, 1))
    found = null_quantile(probs, expected_calibration_error, rng, quantile, num_resamples=4000)
    assert exact[0] - 1e-12 <= found <= exact[1] + 1e-12


def test_labels_are_drawn_with_their_probabilities(rng):
    # Chi-square on 60 000 draws from each of two rows: fails with probability 1e-4.
    probs = np.array([[0.1, 0.2, 0.7], [0.5, 0.0, 0.5]])
    labels = np.concatenate(list(drawn_labels(probs, rng, 60_000)))
    for row, column in zip(probs, labels.T, strict=True):
        counts = np.bincount(column, minlength=3)
        assert counts[row == 0.0].sum() == 0
        assert stats.chisquare(counts[row > 0], 60_000 * row[row > 0]).pvalue > 1e-4


def test_labels_come_in_blocks_that_fit_in_memory(rng, monkeypatch):
    probs = rng.dirichlet(np.ones(3), size=10)
    at_once = np.concatenate(list(drawn_labels(probs, np.random.default_rng(1), 7)))
    monkeypatch.setattr("belief.metrics.chance._BLOCK", 25)
    blocks = list(drawn_labels(probs, np.random.default_rng(1), 7))
    assert [len(block) for block in blocks] == [2, 2, 2, 1]
    np.testing.assert_array_equal(np.concatenate(blocks), at_once)


def test_what_has_probability_zero_never_happens(rng):
    probs = np.array([[0.0, 1.0, 0.0], [0.3, 0.0, 0.7], [1.0, 5e-324, 0.0]])
    assert np.isfinite(null_quantile(probs, negative_log_likelihood, rng, num_resamples=500))


def test_a_calibrated_model_exceeds_its_null_quantile_one_time_in_twenty(rng):
    # 60 models: at most 10 but with probability 3e-4.
    exceeded = 0
    for _ in range(60):
        probs, labels = draw(rng, 100, 1.0)
        quantile = null_quantile(probs, expected_calibration_error, rng, num_resamples=100)
        exceeded += expected_calibration_error(probs, labels) > quantile
    assert 1 <= exceeded <= 10


@pytest.mark.parametrize(
    ("metric", "sharpening", "truth"),
    [
        # Truths: true minus claimed probabilities binned over six million rows; zero where nothing is sharpened.
        (expected_calibration_error, 1.0, 0.0),
        (expected_calibration_error, 1.25, 0.0459),
        (classwise_calibration_error, 1.25, 0.0229),
    ],
)
def test_the_interval_covers_the_true_error(metric, sharpening, truth, rng):
    # 40 data sets: fewer than 31 hits has probability below 1e-3 at a coverage of .93.
    covered = 0
    for _ in range(40):
        probs, labels = draw(rng, 300, sharpening)
        _, low, high = bias_corrected_interval(probs, labels, metric, rng, num_resamples=100)
        covered += low <= truth <= high
    assert covered >= 31


def test_plain_percentiles_of_a_calibrated_model_would_not_cover_zero(rng):
    # What the correction is for: all resamples of all 20 data sets err.
    for _ in range(20):
        probs, labels = draw(rng, 300, 1.0)
        rows = rng.integers(300, size=(20, 300))
        assert min(expected_calibration_error(probs[r], labels[r]) for r in rows) > 0.0
        assert bias_corrected_interval(probs, labels, expected_calibration_error, rng, num_resamples=20)[1] == 0.0


def test_clusters_are_resampled_whole(rng):
    # Every row five times, as one cluster: the same draws, the same shares, the same interval as of the rows once.
    probs, labels = draw(rng, 200, 1.5)
    once = bias_corrected_interval(probs, labels, smooth_calibration_error, np.random.default_rng(1), num_resamples=50)
    five, five_labels = np.repeat(probs, 5, axis=0), np.repeat(labels, 5)
    order = rng.permutation(1000)
    names = np.array([f"object {i:03}" for i in np.repeat(np.arange(200), 5)])
    arguments = five[order], five_labels[order], smooth_calibration_error, np.random.default_rng(1)
    clustered = bias_corrected_interval(*arguments, clusters=names[order], num_resamples=50)
    assert clustered == pytest.approx(once, abs=1e-9)
    independent = bias_corrected_interval(*arguments, num_resamples=50)
    assert independent[2] - independent[1] < 0.6 * (once[2] - once[1])


def test_clusters_of_unequal_size_keep_their_rows_together():
    # One cluster is always right, the other never: a resample's error tells which were drawn.
    seen = set()

    def error(probs, labels):
        seen.add((len(labels), int(labels.sum())))
        return 0.1

    labels = np.array([0, 1, 0, 1, 1])
    clusters = np.array([7, 3, 7, 3, 3])
    bias_corrected_interval([[0.5, 0.5]] * 5, labels, error, np.random.default_rng(0), clusters, num_resamples=40)
    assert seen == {(5, 3), (4, 0), (6, 6)}


def test_a_perfect_model_has_no_error_to_correct(rng):
    probs, labels = np.eye(3)[[0, 1, 2, 0]], np.array([0, 1, 2, 0])
    assert bias_corrected_interval(probs, labels, expected_calibration_error, rng, num_resamples=20) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"probs": [[0.5, 0.5]], "labels": [0]}, "at least two clusters, got 1"),
        ({"clusters": [1, 1]}, "at least two clusters, got 1"),
        ({"clusters": [1, 1, 2]}, "cluster for each of 2 rows"),
        ({"confidence": 95.0}, r"confidence must lie in \(0, 1\), got 95"),
        ({"num_resamples": 0}, "num_resamples must be an integer, at least 1, got 0"),
        ({"metric": lambda probs, labels: np.nan}, "finite number, got nan"),
        ({"metric": lambda probs, labels: -0.1}, "never be negative, got -0.1"),
        ({"probs": [[0.5, np.nan]] * 2}, "row 0 holds"),
    ],
)
def test_intervals_that_cannot_be_are_refused(changes, message, rng):
    arguments = {"probs": [[0.5, 0.5]] * 2, "labels": [0, 1], "metric": expected_calibration_error, "rng": rng}
    with pytest.raises(ValueError, match=message):
        bias_corrected_interval(**(arguments | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"probs": np.zeros((0, 2))}, "n ≥ 1"),
        ({"probs": [[0.5, 0.6]]}, "row 0 holds"),
        ({"quantile": 1.0}, "quantile must lie in"),
        ({"quantile": np.nan}, "quantile must lie in"),
        ({"num_resamples": 1.5}, "num_resamples must be an integer"),
        ({"metric": lambda probs, labels: np.inf}, "finite number, got inf"),
    ],
)
def test_null_quantiles_that_cannot_be_are_refused(changes, message, rng):
    arguments = {"probs": [[0.5, 0.5]], "metric": expected_calibration_error, "rng": rng}
    with pytest.raises(ValueError, match=message):
        null_quantile(**(arguments | changes))


def test_options_of_a_metric_are_given_by_partial(rng):
    one_bin = partial(expected_calibration_error, num_bins=1)
    probs = rng.dirichlet(np.ones(3), size=200)
    few = null_quantile(probs, one_bin, np.random.default_rng(0), num_resamples=100)
    assert few < null_quantile(probs, expected_calibration_error, np.random.default_rng(0), num_resamples=100)
