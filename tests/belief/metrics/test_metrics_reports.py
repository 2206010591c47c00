"""Reliability curves, claims at the stop, and the calibration report."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from belief import metrics
from belief.metrics import calibration_at_stop, calibration_report, reliability_curve


def draw(rng, n=400, num_shapes=3):
    logits = 2.0 * rng.normal(size=(n, num_shapes))
    probs = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    return probs, (rng.random(n)[:, None] >= probs.cumsum(axis=1)[:, :-1]).sum(axis=1)


def number_right(chances):
    """Distribution of the number of heads of unequal coins, by adding one after another."""
    distribution = np.ones(1)
    for chance in chances:
        distribution = np.convolve(distribution, [1.0 - chance, chance])
    return distribution


@pytest.mark.parametrize("binning", ["width", "mass"])
def test_the_curve_adds_up_to_the_calibration_error(binning, rng):
    probs, labels = draw(rng)
    curve = reliability_curve(probs, labels, 10, binning)
    assert curve.count.sum() == 400
    error = (curve.count * np.abs(curve.mean_confidence - curve.accuracy)).sum() / 400
    assert error == pytest.approx(metrics.expected_calibration_error(probs, labels, 10, binning))
    assert ((curve.lower <= curve.mean_confidence) & (curve.mean_confidence <= curve.upper)).all()


def test_a_bin_without_rows_is_left_out():
    curve = reliability_curve([[0.9, 0.1], [0.6, 0.4]], [0, 1], num_bins=10)
    assert curve.lower.tolist() == [0.5, 0.8]
    assert curve.upper.tolist() == [0.6, 0.9]
    assert curve.count.tolist() == [1, 1]
    assert curve.accuracy.tolist() == [0.0, 1.0]


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12), st.sampled_from([0.5, 0.9, 0.95, 0.99]))
def test_the_band_holds_a_calibrated_model_at_least_as_often_as_it_says(chances, confidence):
    # All rows in one bin; the number right of a calibrated model by exact enumeration of unequal coins.
    chances = [max(p, 1.0 - p) for p in chances]
    probs = np.array([[p, 1.0 - p] for p in chances])
    curve = reliability_curve(probs, np.zeros(len(chances), int), num_bins=1, confidence=confidence)
    accuracy = np.arange(len(chances) + 1) / len(chances)
    inside = (curve.band_low[0] <= accuracy) & (accuracy <= curve.band_high[0])
    assert number_right(chances)[inside].sum() >= confidence - 1e-9


def test_the_band_is_binomial_where_confidences_are_equal():
    curve = reliability_curve([[0.8, 0.2]] * 50, [0] * 50)
    assert [50 * curve.band_low[0], 50 * curve.band_high[0]] == list(stats.binom.interval(0.95, 50, 0.8))
    assert not curve.is_consistent[0]  # all right at 80 %


def test_what_is_certain_has_no_band():
    curve = reliability_curve([[1.0, 0.0]] * 3, [0, 0, 0])
    assert curve.band_low.tolist() == curve.band_high.tolist() == [1.0]


def test_the_band_of_a_million_rows_is_narrow():
    curve = reliability_curve(np.tile([0.7, 0.3], (1_000_000, 1)), np.zeros(1_000_000, int))
    reach = 1.96 * np.sqrt(0.21 / 1e6)
    assert [curve.band_low[0], curve.band_high[0]] == pytest.approx([0.7 - reach, 0.7 + reach], abs=1e-6)


def test_claims_are_compared_by_number_of_touches():
    scores = calibration_at_stop([0.9, 1.0, 0.8, 0.6], np.array([1, 1, 0, 1]), [3, 1, 3, 3])
    one, three = scores.by_num_touches
    assert (one.num_touches, one.count, one.mean_stated, one.share_right) == (1, 1, 1.0, 1.0)
    assert (three.num_touches, three.count, three.share_right) == (3, 3, 2 / 3)
    assert three.mean_stated == pytest.approx(2.3 / 3)
    assert three.low == pytest.approx(stats.beta.ppf(0.025, 2, 2))
    assert three.high == pytest.approx(stats.beta.ppf(0.975, 3, 1))
    assert (scores.overall.num_touches, scores.overall.count, scores.overall.share_right) == (None, 4, 0.75)


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans(), st.integers(0, 5)), min_size=1, max_size=30))
def test_claims_of_all_are_the_weighted_claims_of_each(rows):
    scores = calibration_at_stop(*map(list, zip(*rows, strict=True)))
    counts = [s.count for s in scores.by_num_touches]
    assert sum(counts) == scores.overall.count == len(rows)
    for name in ("mean_stated", "share_right"):
        mean = np.average([getattr(s, name) for s in scores.by_num_touches], weights=counts)
        assert getattr(scores.overall, name) == pytest.approx(mean, abs=1e-12)


def test_multiplying_dependent_touches_is_seen_where_the_average_hides_it(rng):
    # One touch claims .8 and is right .9; three claim .99 and are right .9: the averages agree within the interval.
    right = np.tile(np.arange(100) % 10 > 0, 2)
    scores = calibration_at_stop(np.repeat([0.8, 0.99], 100), right, np.repeat([1, 3], 100))
    assert scores.overall.is_consistent
    assert not any(score.is_consistent for score in scores.by_num_touches)


@pytest.mark.parametrize(
    ("claims", "correct", "num_touches", "message"),
    [
        ([], [], [], "at least one"),
        ([0.5], [1, 0], [1, 1], "for each of 2 episodes"),
        ([0.5, 0.5], [1, 0], [1], "for each of 2 episodes"),
        ([0.5, 1.1], [1, 0], [1, 1], "got 1.1 in row 1"),
        ([np.nan], [1], [1], "got nan in row 0"),
        ([0.5], [2], [1], "got 2 in row 0"),
        ([0.5], [np.nan], [1], "got nan in row 0"),
        ([0.5, 0.5], [1, 1], [2, -1], "integers ≥ 0"),
        ([0.5], [1], [1.0], "integers ≥ 0"),
    ],
)
def test_claims_that_cannot_be_are_refused(claims, correct, num_touches, message):
    with pytest.raises(ValueError, match=message):
        calibration_at_stop(claims, correct, num_touches)


def test_the_report_holds_what_the_single_functions_say(rng):
    probs, labels = draw(rng)
    report = calibration_report(probs, labels, np.random.default_rng(1), num_bins=10, num_resamples=30)
    assert report.num_rows == 400
    assert report.accuracy == metrics.accuracy(probs, labels)
    assert report.negative_log_likelihood == pytest.approx(metrics.negative_log_likelihood(probs, labels))
    assert report.brier == pytest.approx(metrics.brier_score(probs, labels))
    assert report.ece_width.value == pytest.approx(metrics.expected_calibration_error(probs, labels, 10))
    assert report.ece_mass.value == pytest.approx(metrics.expected_calibration_error(probs, labels, 10, "mass"))
    assert report.ece_classwise.value == pytest.approx(metrics.classwise_calibration_error(probs, labels, 10))
    assert report.smooth.value == pytest.approx(metrics.smooth_calibration_error(probs, labels))
    assert report.curve.count.sum() == 400
    first = metrics.null_quantile(
        probs, lambda p, y: metrics.expected_calibration_error(p, y, 10), np.random.default_rng(1), num_resamples=30
    )
    assert report.ece_width.null_quantile == pytest.approx(first)


def test_the_report_of_a_false_model_says_so_and_that_of_a_true_one_does_not(rng):
    probs, labels = draw(rng, 800)
    sharper = probs**2 / (probs**2).sum(axis=1, keepdims=True)
    errors = ("ece_width", "ece_mass", "ece_classwise", "smooth")
    false, true = calibration_report(sharper, labels), calibration_report(probs, labels)
    assert all(getattr(false, name).exceeds_chance for name in errors)
    assert not any(getattr(true, name).exceeds_chance for name in errors)
    assert [row["exceeds_chance"] for row in false.rows()] == ["yes"] * 4


def test_equal_data_give_equal_reports(rng):
    probs, labels = draw(rng, 50)
    reports = [calibration_report(probs, labels, num_resamples=20).rows() for _ in range(2)]
    assert reports[0] == reports[1]


def test_one_row_has_a_report():
    report = calibration_report([[0.6, 0.4]], [1], num_resamples=20)
    assert report.accuracy == 0.0
    assert report.ece_width.value == pytest.approx(0.6)
