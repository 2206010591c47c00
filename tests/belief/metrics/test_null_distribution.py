"""What chance does to calibration errors: against exact distributions."""

import numpy as np
import pytest
from scipy import stats

from belief.metrics import (
    expected_calibration_error,
    negative_log_likelihood,
    null_quantile,
)
from belief.metrics.report import drawn_labels


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
    monkeypatch.setattr("belief.metrics.report._BLOCK", 25)
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
    ("changes", "message"),
    [
        ({"probs": np.zeros((0, 2))}, "n ≥ 1"),
        ({"probs": [[0.5, 0.6]]}, r"row 0 \(from 0\) holds"),
        ({"quantile": 1.0}, "quantile must be a number in"),
        ({"quantile": np.nan}, "quantile must be a number in"),
        ({"num_resamples": 1.5}, "num_resamples must be an integer"),
        ({"metric": lambda probs, labels: np.inf}, "finite numbers, got inf"),
    ],
)
def test_null_quantiles_that_cannot_be_are_refused(changes, message, rng):
    arguments = {"probs": [[0.5, 0.5]], "metric": expected_calibration_error, "rng": rng}
    with pytest.raises(ValueError, match=message):
        null_quantile(**(arguments | changes))
