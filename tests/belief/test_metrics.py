"""Hand-derived values, and what a perfectly calibrated model scores."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief import metrics
from belief.metrics import shape_scores


def test_a_perfect_prediction_scores_zero_everywhere():
    probs, labels = np.eye(3), np.arange(3)
    assert metrics.accuracy(probs, labels) == 1.0
    assert metrics.negative_log_likelihood(probs, labels) == 0.0
    assert metrics.brier_score(probs, labels) == 0.0
    assert metrics.expected_calibration_error(probs, labels) == 0.0


def test_a_label_of_probability_zero_costs_infinity():
    assert metrics.negative_log_likelihood([[1.0, 0.0]], [1]) == np.inf


def test_calibration_error_by_hand():
    # Three rows at .9, of which two right: gap |.9 - 2/3|; one at .6, right: gap .4. Weighted 3:1.
    probs, labels = [[0.9, 0.1]] * 3 + [[0.6, 0.4]], [0, 0, 1, 0]
    expected = 0.75 * abs(0.9 - 2 / 3) + 0.25 * 0.4
    assert metrics.expected_calibration_error(probs, labels) == pytest.approx(expected)


def test_bins_are_open_below_and_closed_above():
    # .6 and .5 lie in different bins of width .1, (.5, .6] and (.4, .5]: gaps +.6 and -.5 must not cancel.
    probs, labels = [[0.6, 0.4], [0.5, 0.5]], [1, 0]
    assert metrics.expected_calibration_error(probs, labels, num_bins=10) == pytest.approx((0.6 + 0.5) / 2)


@pytest.mark.parametrize("binning", ["width", "mass"])
def test_labels_drawn_from_the_predictions_are_nearly_calibrated(rng, binning):
    # 15 bins of about 1 300 rows: the expected error by chance is below .011 (mean |N(0, .013)|).
    probs = rng.dirichlet(np.ones(3), size=20_000)
    labels = (rng.random(20_000)[:, None] > probs.cumsum(axis=1)).sum(axis=1)
    assert metrics.expected_calibration_error(probs, labels, binning=binning) < 0.02


def test_confusion_counts_true_shapes_in_rows():
    matrix = metrics.confusion_matrix([[0.9, 0.1], [0.2, 0.8], [0.7, 0.3]], [0, 1, 1])
    assert matrix.tolist() == [[1, 0], [1, 1]]


@pytest.mark.parametrize("metric", [metrics.accuracy, metrics.negative_log_likelihood, metrics.brier_score])
@pytest.mark.parametrize(
    ("probs", "labels", "message"),
    [
        (np.zeros((0, 2)), np.zeros(0, int), "n ≥ 1"),
        ([[0.5, 0.5], [0.5, 0.6]], [0, 0], "row 1 are no distribution"),
        ([[np.nan, 1.0]], [0], "row 0 are no distribution"),
        ([[0.5, 0.5]], [2], "integers in"),
    ],
)
def test_bad_input_raises_and_says_where(metric, probs, labels, message):
    with pytest.raises(ValueError, match=message):
        metric(probs, np.array(labels))


@given(arrays(np.int64, (4, 4), elements=st.integers(0, 50)))
def test_shape_scores_are_those_of_counting(confusion):
    pairs = [(t, r) for (t, r), n in np.ndenumerate(confusion) for _ in range(n)]
    for k, score in enumerate(shape_scores(confusion)):
        true, read = [p for p in pairs if p[0] == k], [p for p in pairs if p[1] == k]
        both = len([p for p in true if p[1] == k])
        assert score.support == len(true)
        assert score.recall == pytest.approx(both / len(true) if true else 0.0)
        assert score.precision == pytest.approx(both / len(read) if read else 0.0)
        mean = 2 / (1 / score.precision + 1 / score.recall) if both else 0.0
        assert score.f1 == pytest.approx(mean)


@pytest.mark.parametrize("counts", [np.zeros((0, 0)), np.zeros((2, 3)), [[-1, 0], [0, 1]], [[np.nan, 0], [0, 1]]])
def test_shape_scores_refuse_what_is_no_confusion_matrix(counts):
    with pytest.raises(ValueError, match="counts"):
        shape_scores(counts)
