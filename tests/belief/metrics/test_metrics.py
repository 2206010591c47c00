"""Hand-derived values, brute force over bins, laws, and what a perfectly calibrated model scores."""

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief import Belief, metrics, validation
from belief.calibration import logits_from_probs
from belief.metrics import shape_scores
from belief.metrics.scores import bin_index

SCORES = {
    "accuracy": metrics.accuracy,
    "negative log-likelihood": metrics.negative_log_likelihood,
    "Brier": metrics.brier_score,
}
ERRORS = {
    "width": metrics.expected_calibration_error,
    "mass": partial(metrics.expected_calibration_error, binning="mass"),
    "classwise width": metrics.classwise_calibration_error,
    "classwise mass": partial(metrics.classwise_calibration_error, binning="mass"),
    "smooth": metrics.smooth_calibration_error,
}
METRICS = {**SCORES, **ERRORS}
# Edges of mass bins, and what chance adds, depend on the number of rows and not only on their shares.
OF_SHARES = sorted(set(METRICS) - {"mass", "classwise mass"})


def draw(rng, n=300, num_shapes=4, sharpening=1.4):
    """Over-confident predictions, and labels."""
    logits = 2.0 * rng.normal(size=(n, num_shapes))
    true_probs = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    labels = (rng.random(n)[:, None] >= true_probs.cumsum(axis=1)[:, :-1]).sum(axis=1)
    probs = np.exp(sharpening * logits)
    return probs / probs.sum(axis=1, keepdims=True), labels


def error_by_hand(predicted, happened, num_bins):
    """The binned error by exact fractions, one bin (lo, hi] after another, the first closed."""
    total = Fraction(0)
    for b in range(num_bins):
        inside = [i for i, p in enumerate(predicted) if b < p * num_bins <= b + 1 or (b == 0 and p == 0)]
        total += abs(sum((predicted[i] - happened[i] for i in inside), Fraction(0)))
    return total / len(predicted)


def test_a_perfect_prediction_scores_zero_everywhere():
    probs, labels = np.eye(3), np.arange(3)
    assert metrics.accuracy(probs, labels) == 1.0
    for name, metric in METRICS.items():
        if name not in ("accuracy", "resolution", "uncertainty"):
            assert metric(probs, labels) == 0.0, name


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


@pytest.mark.parametrize("num_bins", [1, 3, 7, 10, 15, 49, 1000])
def test_every_edge_belongs_to_the_bin_below_it_and_the_next_number_to_that_above(num_bins):
    edges = np.arange(num_bins + 1) / num_bins
    assert bin_index(edges, num_bins, "width").tolist() == [0, *range(num_bins)]
    assert bin_index(np.nextafter(edges[:-1], 1.0), num_bins, "width").tolist() == list(range(num_bins))


@given(st.lists(st.tuples(st.integers(0, 30), st.booleans()), min_size=1, max_size=12), st.sampled_from([1, 2, 5, 15]))
def test_binned_errors_are_those_of_exact_fractions(rows, num_bins):
    # Probabilities k/30 of the first of two shapes: many fall on edges.
    first = [Fraction(k, 30) for k, _ in rows]
    labels = [int(is_second) for _, is_second in rows]
    probs = np.array([[float(p), float(1 - p)] for p in first])
    shapes = [
        error_by_hand(first, [1 - y for y in labels], num_bins),
        error_by_hand([1 - p for p in first], labels, num_bins),
    ]
    assert metrics.classwise_calibration_error(probs, labels, num_bins) == pytest.approx(
        float(sum(shapes) / 2), abs=1e-12
    )
    confidence = [max(p, 1 - p) for p in first]
    right = [y == (p < Fraction(1, 2)) for p, y in zip(first, labels, strict=True)]
    expected = float(error_by_hand(confidence, right, num_bins))
    assert metrics.expected_calibration_error(probs, labels, num_bins) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_probabilities_in_steps_of_a_bin_have_the_error_of_exact_fractions(seed):
    # Sums of three such probabilities are one up to rounding; dividing by them would move 6/15 across an edge.
    rng = np.random.default_rng(seed)
    counts = rng.multinomial(15, [0.5, 0.3, 0.2], size=400)
    labels = (rng.random((400, 1)) > np.cumsum(counts / 15, axis=1)[:, :2]).sum(axis=1)
    exact = [[Fraction(int(k), 15) for k in row] for row in counts]
    right = counts.argmax(axis=1) == labels
    expected = error_by_hand([max(row) for row in exact], right, 15)
    assert metrics.expected_calibration_error(counts / 15, labels) == pytest.approx(float(expected), abs=1e-12)
    expected = sum(error_by_hand([row[k] for row in exact], labels == k, 15) for k in range(3)) / 3
    assert metrics.classwise_calibration_error(counts / 15, labels) == pytest.approx(float(expected), abs=1e-12)
    bins = [-(-max(row) // Fraction(1, 15)) for row in exact]
    assert metrics.reliability_curve(counts / 15, labels).count.tolist() == [bins.count(b) for b in sorted({*bins})]


@pytest.mark.parametrize("num_rows", [2, 16, 76, 91, 151, 171, 301])
def test_mass_bins_are_those_of_exact_ranks(num_rows):
    ranks = np.arange(num_rows)
    for num_bins in (5, 10, 15, 20, 25):
        exact = [max(-(-rank * num_bins // (num_rows - 1)) - 1, 0) for rank in ranks.tolist()]
        assert bin_index(ranks / 512, num_bins, "mass").tolist() == exact


@pytest.mark.parametrize(
    ("normalise", "takes_logs", "gives_logs"),
    [
        (validation.normalise_probs, False, False),
        (validation.renormalised, False, False),
        (lambda probs: validation.checked_pair(probs, np.zeros(len(probs), int))[0], False, False),
        (lambda probs: [Belief.from_probs(tuple("abc"), row).log_probs for row in probs], False, True),
        (logits_from_probs, False, True),
        (validation.normalise_log_probs, True, True),
        (lambda logs: [Belief(tuple("abc"), row).log_probs for row in logs], True, True),
    ],
)
def test_rows_that_sum_to_one_up_to_rounding_are_left_as_they_are(normalise, takes_logs, gives_logs, rng):
    normal = (rng.multinomial(12, [0.5, 0.3, 0.2], size=100) + 1) / 15
    rows = np.vstack([normal, [[0.501, 0.3, 0.2]]])  # the last is to be divided, which changes no other row
    found = np.asarray(normalise(np.log(rows) if takes_logs else rows))
    np.testing.assert_array_equal(found[:-1], np.log(normal) if gives_logs else normal)
    assert (np.exp(found[-1]) if gives_logs else found[-1]).sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("metric", [*METRICS.values(), metrics.reliability_curve])
def test_a_certainty_above_one_by_rounding_is_a_certainty(metric):
    assert str(metric([[1.0 + 5e-10, 0.0]] * 3, [0, 0, 1])) == str(metric([[1.0, 0.0]] * 3, [0, 0, 1]))


def test_mass_bins_hold_as_many_rows_each(rng):
    counts = np.bincount(bin_index(rng.random(103), 10, "mass"))
    assert counts.min() >= 10
    assert counts.max() <= 11


@pytest.mark.parametrize("binning", ["width", "mass"])
def test_columns_have_bins_of_their_own(binning, rng):
    columns = rng.random((50, 3)) ** [1, 3, 9]  # of unlike quantiles
    found = bin_index(columns, 7, binning)
    for column, own in zip(columns.T, found.T, strict=True):
        np.testing.assert_array_equal(own, bin_index(column, 7, binning))


def test_equal_confidences_share_a_mass_bin():
    index = bin_index(np.array([0.4] * 7 + [0.9] * 3), 5, "mass")
    assert len(set(index[:7])) == 1
    assert len(set(index[7:])) == 1


@pytest.mark.parametrize("binning", ["width", "mass"])
def test_labels_drawn_from_the_predictions_are_nearly_calibrated(rng, binning):
    # 15 bins of about 1 300 rows: the expected error by chance is below .011 (mean |N(0, .013)|).
    probs = rng.dirichlet(np.ones(3), size=20_000)
    labels = (rng.random(20_000)[:, None] > probs.cumsum(axis=1)).sum(axis=1)
    assert metrics.expected_calibration_error(probs, labels, binning=binning) < 0.02


@pytest.mark.parametrize("name", sorted(ERRORS))
def test_every_error_of_rows_that_are_all_wrong_is_their_confidence(name):
    for n in range(1, 101):
        confidence = np.linspace(0.8, 0.99, n)
        error = ERRORS[name](np.stack([confidence, 1.0 - confidence], axis=1), np.ones(n, int))
        assert error == pytest.approx(confidence.mean(), abs=0.01)


@pytest.mark.parametrize("name", METRICS)
def test_the_order_of_rows_does_not_matter(name, rng):
    probs, labels = draw(rng)
    order = rng.permutation(len(labels))
    assert METRICS[name](probs[order], labels[order]) == pytest.approx(METRICS[name](probs, labels), abs=1e-12)


@pytest.mark.parametrize("name", METRICS)
def test_the_names_of_shapes_do_not_matter(name, rng):
    probs, labels = draw(rng)
    new_name = rng.permutation(4)
    renamed = np.empty_like(probs)
    renamed[:, new_name] = probs
    assert METRICS[name](renamed, new_name[labels]) == pytest.approx(METRICS[name](probs, labels), abs=1e-12)


@pytest.mark.parametrize("name", OF_SHARES)
def test_every_row_twice_changes_nothing(name, rng):
    probs, labels = draw(rng)
    twice = METRICS[name](np.repeat(probs, 2, axis=0), np.repeat(labels, 2))
    assert twice == pytest.approx(METRICS[name](probs, labels), abs=1e-10)


@pytest.mark.parametrize("name", OF_SHARES)
def test_a_million_rows_score_as_the_thousand_they_repeat(name, rng):
    probs, labels = draw(rng, 1000, 2)
    million = METRICS[name](np.tile(probs, (1000, 1)), np.tile(labels, 1000))
    assert million == pytest.approx(METRICS[name](probs, labels), rel=1e-8)


@pytest.mark.parametrize("name", METRICS)
def test_one_shape_is_always_known(name):
    assert METRICS[name]([[1.0], [1.0]], [0, 0]) == (1.0 if name == "accuracy" else 0.0)


@pytest.mark.parametrize("name", METRICS)
def test_half_precision_is_renormalised(name, rng):
    probs, labels = draw(rng, 200, 12)
    half = probs.astype(np.float16)
    renormalised = half / half.astype(float).sum(axis=1, keepdims=True)
    assert METRICS[name](half, labels) == pytest.approx(METRICS[name](renormalised, labels), abs=1e-12)


@pytest.mark.parametrize("name", METRICS)
@pytest.mark.parametrize(
    ("probs", "labels", "message"),
    [
        (np.zeros((0, 2)), np.zeros(0, int), "n ≥ 1"),
        (np.zeros((2, 0)), np.zeros(2, int), "n ≥ 1"),
        ([0.5, 0.5], [0, 1], "n ≥ 1"),
        ([[0.5, 0.5]], [0, 1], "n ≥ 1"),
        ([[0.5, 0.5], [0.5, 0.6]], [0, 0], r"row 1 \(from 0\) holds"),
        ([[np.nan, 1.0]], [0], r"row 0 \(from 0\) holds"),
        ([[0.5, 0.5], [np.inf, -np.inf]], [0, 0], r"row 1 \(from 0\) holds"),
        ([[1e308, 1e308]], [0], r"row 0 \(from 0\) holds"),
        ([[1.5, -0.5]], [0], r"row 0 \(from 0\) holds"),
        ([[0.5, 0.5]], [2], r"got 2 in row 0 \(from 0\)"),
        ([[0.5, 0.5], [0.5, 0.5]], [0, -1], "got -1 in row 1"),
        ([[0.5, 0.5]], [0.0], "integers in"),
    ],
)
def test_bad_input_raises_and_says_where(name, probs, labels, message):
    with pytest.raises(ValueError, match=message):
        METRICS[name](probs, np.array(labels))


@pytest.mark.parametrize(
    "metric",
    [
        metrics.expected_calibration_error,
        metrics.classwise_calibration_error,
        metrics.reliability_curve,
    ],
)
def test_impossible_bins_are_refused(metric):
    for num_bins in (0, -1, 2.5, np.nan, 10**9):
        with pytest.raises(ValueError, match="num_bins"):
            metric([[0.5, 0.5]], [0], num_bins=num_bins)
    with pytest.raises(ValueError, match="'width' or 'mass', got 'weight'"):
        metric([[0.5, 0.5]], [0], binning="weight")


def test_confusion_counts_true_shapes_in_rows():
    matrix = metrics.confusion_matrix([[0.9, 0.1], [0.2, 0.8], [0.7, 0.3]], [0, 1, 1])
    assert matrix.tolist() == [[1, 0], [1, 1]]


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


@pytest.mark.parametrize("dtype", [np.int8, np.uint8, np.int16, np.int32, np.int64, np.float16])
def test_shape_scores_of_the_largest_counts_of_a_type_do_not_overflow(dtype):
    most = int((np.finfo if dtype is np.float16 else np.iinfo)(dtype).max)
    for score in shape_scores(np.full((2, 2), most, dtype)):
        assert (score.precision, score.recall, score.f1) == (0.5, 0.5, 0.5)
        assert isinstance(score.support, int)
        assert score.support == pytest.approx(2 * most, rel=1e-15)
