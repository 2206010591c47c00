"""Temperature scaling against 40-digit arithmetic, and a stated status wherever there is no optimum."""

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.special import softmax

from belief.calibration import TemperatureScaling

pytestmark = [
    pytest.mark.filterwarnings("ignore:logits has no negative number:UserWarning"),
    pytest.mark.filterwarnings("ignore:all .* labels are .*:UserWarning"),
]


def sample(rng, n=400, num_shapes=4, temperature=2.0):
    """Logits, and labels drawn from their softmax at this temperature."""
    logits = rng.normal(size=(n, num_shapes)) * 3
    labels = np.array([rng.choice(num_shapes, p=softmax(row / temperature)) for row in logits])
    return logits, labels


def reference_temperature(logits, labels) -> float:
    """Root of the derivative of the mean NLL in the inverse temperature, with 40 digits."""
    with mpmath.workdps(40):
        rows = [[mpmath.mpf(float(z)) for z in row] for row in logits]

        def slope(beta):
            total = mpmath.mpf(0)
            for row, label in zip(rows, labels, strict=True):
                top = max(row)
                weights = [mpmath.exp(beta * (z - top)) for z in row]
                total += mpmath.fdot(weights, row) / mpmath.fsum(weights) - row[label]
            return total

        scale = max(abs(z) for row in rows for z in row)
        return float(1 / mpmath.findroot(slope, (mpmath.mpf(1) / scale, 4 / scale), solver="anderson"))


@pytest.mark.parametrize("unit", [1.0, 1e-300, 1e4, 1e307])
def test_temperature_agrees_with_forty_digits_in_any_unit(rng, unit):
    logits, labels = sample(rng, n=60)
    fitted = TemperatureScaling().fit(logits * unit, labels)
    assert fitted.status == "ok"
    assert fitted.temperature == pytest.approx(reference_temperature(logits, labels) * unit, rel=1e-10)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_low_precision_logits_are_taken_as_they_are(rng, dtype):
    logits, labels = sample(rng, n=60)
    rounded = logits.astype(dtype)
    fitted = TemperatureScaling().fit(rounded, labels)
    assert fitted.temperature == pytest.approx(reference_temperature(rounded.astype(float), labels), rel=1e-10)


def test_one_row_of_another_scale_does_not_spoil_the_others(rng):
    logits, labels = sample(rng, n=60)
    right = np.array([1e306, 0.0, 0.0, 0.0])  # as sure as can be at any temperature near the others' one
    fitted = TemperatureScaling().fit(np.vstack([logits, right]), np.append(labels, 0))
    assert fitted.temperature == pytest.approx(reference_temperature(logits, labels), rel=1e-10)


def test_a_million_rows_are_fitted_as_exactly_as_the_few(rng):
    logits, labels = sample(rng, n=60)
    many, theirs = np.repeat(logits, 17_000, axis=0), np.repeat(labels, 17_000)  # which leaves the optimum where it was
    assert TemperatureScaling().fit(many, theirs).temperature == pytest.approx(
        reference_temperature(logits, labels), rel=1e-10
    )


@given(
    arrays(np.int64, (8, 3), elements=st.integers(-3, 3)),
    arrays(np.float64, (8, 1), elements=st.sampled_from([1e-8, 1e-3, 1.0, 1e3, 1e8])),
    arrays(np.int64, 8, elements=st.integers(0, 2)),
)
def test_no_neighbouring_temperature_is_more_likely(numbers, units, labels):
    logits = numbers * units
    fitted = TemperatureScaling().fit(logits, labels)
    assume(fitted.status == "ok")
    best, slope = fitted.objective(logits, labels)
    assert abs(slope[0]) < 1e-10
    for factor in (0.999, 1.001):
        assert best <= TemperatureScaling(fitted.temperature * factor).objective(logits, labels)[0] + 1e-15


@given(arrays(np.float64, (6, 3), elements=st.floats(-1e3, 1e3)), st.floats(1e-6, 1e6))
def test_scaling_keeps_the_argmax_and_leaves_distributions(logits, temperature):
    probs = TemperatureScaling(temperature, "ok").predict_proba(logits)
    np.testing.assert_allclose(probs.sum(axis=1), 1.0, atol=1e-12)
    best = np.take_along_axis(probs, logits.argmax(axis=1)[:, None], axis=1)[:, 0]
    np.testing.assert_array_equal(best, probs.max(axis=1))


@pytest.mark.parametrize("options", [{"temperature": -1.0}, {"temperature": np.inf}, {"floor": 1.0}])
def test_a_temperature_that_is_none_is_refused(options):
    with pytest.raises(ValueError, match=r"temperature must be a finite number > 0|floor must be a number in \[0, 1\)"):
        TemperatureScaling(**options)


def test_a_status_that_no_fit_gives_is_refused():
    with pytest.raises(ValueError, match="status must be one of"):
        TemperatureScaling(1.0, "fine")


@pytest.mark.parametrize("temperature", [5e-324, 1e-6, 1e6, 1e308])
def test_the_most_extreme_temperatures_give_distributions(temperature):
    logits = np.array([[1e308, -1e308, 0.0], [1e4, 0.0, -1e4], [5e-324, 0.0, 0.0], [0.0, 0.0, 0.0]])
    log_probs = TemperatureScaling(temperature, "ok").predict_log_proba(logits)
    assert np.isfinite(log_probs).all()
    np.testing.assert_allclose(np.exp(log_probs).sum(axis=1), 1.0)
    np.testing.assert_allclose(log_probs[3], -np.log(3.0))


def test_the_least_floor_is_still_a_floor():
    assert TemperatureScaling(1.0, "ok", floor=5e-324).predict_log_proba([1e4, 0.0, 0.0]).min() > -750.0
