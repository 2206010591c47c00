"""Whatever is put in: an error that says so, or finite numbers, and no warning."""

from collections import Counter
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belief import metrics, statistics

EXTREMES = [0.0, 1.0, -0.0, -1.0, 0.5, 1e-3, 1e-8, 5e-324, 1e-300, 1e308, -1e308, np.inf, -np.inf, np.nan]
FEW = 5  # resamples


def numbers(shape):
    return arrays(np.float64, shape, elements=st.sampled_from(EXTREMES) | st.floats(width=64))


@st.composite
def predictions(draw):
    """Arrays of any float type, most of them distributions with extreme entries; labels mostly in range."""
    n, num_shapes = draw(st.integers(1, 6)), draw(st.integers(1, 4))
    dtype = draw(st.sampled_from([np.float16, np.float32, np.float64]))
    if draw(st.integers(0, 3)) == 0:
        with np.errstate(over="ignore"):
            probs = draw(numbers((n, num_shapes))).astype(dtype)
    else:
        small = st.sampled_from([0.0, 0.0, 1.0, 1.0, 0.5, 1e-3, 1e-8, 5e-324, 1e-300])
        weights = draw(arrays(np.float64, (n, num_shapes), elements=small))
        weights[weights.max(axis=1) < 1e-3, 0] = 1.0
        probs = (weights / weights.sum(axis=1, keepdims=True)).astype(dtype)
    labels = draw(arrays(np.int64, n, elements=st.integers(0, num_shapes - 1)))
    if draw(st.integers(0, 7)) == 0:
        labels[-1] = num_shapes
    return probs, labels


def rng():
    return np.random.default_rng(0)


def is_finite(result):
    if is_dataclass(result):
        return all(is_finite(getattr(result, field.name)) for field in fields(result))
    if isinstance(result, tuple | list):
        return all(map(is_finite, result))
    return result is None or isinstance(result, str) or bool(np.isfinite(np.asarray(result, np.float64)).all())


def outcome(function, *arguments):
    """The result, or None where the input was refused."""
    try:
        return function(*arguments)
    except ValueError:
        return None


OF_PREDICTIONS = {
    "accuracy": metrics.accuracy,
    "brier_score": metrics.brier_score,
    "confusion_matrix": metrics.confusion_matrix,
    "expected_calibration_error": metrics.expected_calibration_error,
    "expected_calibration_error mass": lambda p, y: metrics.expected_calibration_error(p, y, binning="mass"),
    "classwise_calibration_error": metrics.classwise_calibration_error,
    "classwise_calibration_error mass": lambda p, y: metrics.classwise_calibration_error(p, y, binning="mass"),
    "smooth_calibration_error": metrics.smooth_calibration_error,
    "reliability_curve": metrics.reliability_curve,
    "reliability_curve of a shape": lambda p, y: metrics.reliability_curve(p, y, shape=0),
    "reliability_curve mass": lambda p, y: metrics.reliability_curve(p, y, binning="mass", shape=0),
    "null_quantile": lambda p, y: metrics.null_quantile(p, metrics.brier_score, rng(), num_resamples=FEW),
    "bias_corrected_interval": lambda p, y: metrics.bias_corrected_interval(
        p, y, metrics.classwise_calibration_error, rng(), num_resamples=FEW
    ),
}


def test_metrics_of_anything_are_finite_or_refused():
    tried, answered = 0, Counter()

    @settings(max_examples=60)
    @given(predictions())
    def attempt(given_):
        nonlocal tried
        tried += 1
        for name, metric in OF_PREDICTIONS.items():
            result = outcome(metric, *given_)
            assert result is None or is_finite(result), name
            answered[name] += result is not None

    attempt()
    for name in OF_PREDICTIONS:
        assert answered[name] >= tried / 5, name  # most of the predictions are distributions


@given(predictions())
def test_the_likelihood_is_finite_unless_a_label_had_no_probability(given_):
    probs, labels = given_
    result = outcome(metrics.negative_log_likelihood, probs, labels)
    if result is not None:
        assert np.isfinite(result) == (probs[np.arange(len(labels)), labels] > 0).all()
        assert result >= 0.0


@settings(max_examples=40)
@given(predictions())
def test_only_the_likelihood_of_a_report_may_be_infinite(given_):
    report = outcome(lambda p, y: metrics.calibration_report(p, y, num_resamples=2), *given_)
    if report is not None:
        assert all(is_finite(getattr(report, f.name)) for f in fields(report) if f.name != "negative_log_likelihood")
        assert str(report)


@st.composite
def pairs(draw):
    n = draw(st.integers(0, 6))
    return draw(numbers(n)), draw(numbers(n))


OF_PAIRS = {
    "paired_bootstrap": lambda x, y: statistics.paired_bootstrap(x, y, rng(), num_resamples=FEW),
    "cluster_bootstrap": lambda x, y: statistics.cluster_bootstrap(x, y, rng(), num_resamples=FEW),
    "mcnemar_test": statistics.mcnemar_test,
    "pareto_front": statistics.pareto_front,
    "pareto_probabilities": lambda x, y: statistics.pareto_probabilities(x[None], y[None]),
    "calibration_at_stop": lambda x, y: metrics.calibration_at_stop(x, y == 1.0, np.arange(len(x))),
    "shape_scores": lambda x, y: metrics.shape_scores(np.outer(np.abs(x), np.abs(y))),
    "wilson_interval": lambda x, y: statistics.wilson_interval(x[0] if len(x) else 0, y[0] if len(y) else 0),
    "clopper_pearson_interval": lambda x, y: statistics.clopper_pearson_interval(
        x[0] if len(x) else 0, y[0] if len(y) else 0
    ),
    "confidence": lambda x, y: statistics.wilson_interval(1, 2, y[0] if len(y) else 0.5),
}


ORDINARY = {
    "wilson_interval": ([3.0], [5.0]),
    "clopper_pearson_interval": ([3.0], [5.0]),
    "confidence": ([0.0], [0.9]),
}


@pytest.mark.parametrize("name", OF_PAIRS)
def test_statistics_of_ordinary_numbers_are_answered(name):
    x, y = map(np.array, ORDINARY.get(name, ([1.0, 0.0, 1.0, 0.0], [1.0, 1.0, 0.0, 1.0])))
    assert is_finite(OF_PAIRS[name](x, y))


@settings(max_examples=60)
@given(pairs())
def test_statistics_of_anything_are_finite_or_refused(given_):
    for name, statistic in OF_PAIRS.items():
        numbers_ = given_
        if name == "shape_scores":  # the products are the test's own
            numbers_ = tuple(np.nan_to_num(np.minimum(np.abs(x), 1e150)) for x in given_)
        result = outcome(statistic, *numbers_)
        assert result is None or is_finite(result), name
