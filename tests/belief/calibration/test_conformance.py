"""What every calibration in the table owes its callers, however strange the data."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.special import log_softmax

from belief import Belief, Touch
from belief.calibration import CALIBRATIONS, PerPose, logits_from_probs
from belief.observation_model import calibration_of_stops, certified_stops, fit_observation_model
from belief.synthetic import random_model

pytestmark = [
    pytest.mark.filterwarnings("ignore:logits has no negative number:UserWarning"),
    pytest.mark.filterwarnings("ignore:all .* labels are .*:UserWarning"),
]
LABELS = ("cube", "sphere", "cone")
every_calibration = pytest.mark.parametrize("name", CALIBRATIONS)
ODD_NUMBERS = [0.0, 1.0, -1.0, 0.5, 5e-324, -1e-310, 1e-300, 1e-16, 1e4, -1e4, 1e154, 1e308, -1e308]


def sample(rng, n=300, num_shapes=3):
    """Logits, and labels that a temperature alone does not explain."""
    logits = 3.0 * rng.normal(size=(n, num_shapes))
    scores = logits * np.linspace(0.3, 1.0, num_shapes) + np.linspace(-1.0, 1.0, num_shapes)
    return logits, (scores + rng.gumbel(size=scores.shape)).argmax(axis=1)


def assert_distributions(log_probs):
    assert np.isfinite(log_probs).all()
    np.testing.assert_allclose(np.exp(log_probs).sum(axis=-1), 1.0, atol=1e-12)


@every_calibration
def test_before_the_fit_it_is_the_plain_softmax(name, rng):
    logits, _ = sample(rng)
    calibration = CALIBRATIONS[name]()
    assert calibration.status == "unfitted"
    np.testing.assert_allclose(calibration.predict_log_proba(logits), log_softmax(logits, axis=1), atol=1e-14)
    with pytest.warns(UserWarning, match=f"{type(calibration).__name__} is not fitted; fit returns a new object"):
        np.testing.assert_allclose(calibration.predict_proba(logits).sum(axis=1), 1.0)


@every_calibration
def test_fitting_leaves_the_object_alone_and_lowers_the_loss(name, rng):
    logits, labels = sample(rng)
    unfitted = CALIBRATIONS[name]()
    fitted = unfitted.fit(logits, labels)
    assert (unfitted.status, fitted.status) == ("unfitted", "ok")
    losses = [-c.predict_log_proba(logits)[np.arange(len(labels)), labels].mean() for c in (unfitted, fitted)]
    assert losses[1] < losses[0] - 0.1


@every_calibration
@pytest.mark.parametrize("separable", [False, True])
def test_a_row_of_weight_two_counts_as_two_rows_and_one_of_weight_zero_not_at_all(name, rng, separable):
    logits, labels = sample(rng)
    labels = logits.argmax(axis=1) if separable else labels
    counts = rng.integers(4, size=len(labels))
    weighted = CALIBRATIONS[name]().fit(np.where(counts[:, None], logits, 1e300), labels, counts)
    repeated = CALIBRATIONS[name]().fit(logits.repeat(counts, axis=0), labels.repeat(counts))
    assert weighted.status == repeated.status
    probs = [one.predict_log_proba(logits) for one in (weighted, repeated)]
    np.testing.assert_allclose(*probs, rtol=1e-7, atol=1e-9)
    plain, ones = (CALIBRATIONS[name]().fit(logits, labels, w).predict_log_proba(logits) for w in (None, np.ones(300)))
    np.testing.assert_array_equal(plain, ones)


@every_calibration
@pytest.mark.parametrize("unit", [1e-300, 1.0, 1e4, 1e307])
def test_the_gradient_of_the_objective_vanishes_at_the_fit(name, rng, unit):
    logits, labels = sample(rng)
    fitted = CALIBRATIONS[name]().fit(logits * unit, labels)
    _, gradient = fitted.objective(logits * unit, labels)
    assert np.abs(gradient).max() < 1e-10


@every_calibration
@pytest.mark.parametrize("unit", [1e-300, 1e4, 1e307])
def test_the_unit_of_the_logits_does_not_matter(name, rng, unit):
    logits, labels = sample(rng)
    calibration = CALIBRATIONS[name]()
    here = calibration.fit(logits, labels).predict_log_proba(logits)
    there = calibration.fit(logits * unit, labels).predict_log_proba(logits * unit)
    np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-9)


@every_calibration
def test_a_constant_added_to_a_row_changes_nothing(name, rng):
    logits, labels = sample(rng)
    shifted = logits + 100.0 * rng.normal(size=(len(labels), 1))
    calibration = CALIBRATIONS[name]()
    expected = calibration.fit(logits, labels).predict_log_proba(logits)
    np.testing.assert_allclose(calibration.fit(shifted, labels).predict_log_proba(shifted), expected, atol=1e-10)


@every_calibration
def test_any_leading_axes_are_kept(name, rng):
    logits, labels = sample(rng)
    fitted = CALIBRATIONS[name]().fit(logits, labels)
    rows = fitted.predict_log_proba(logits[:6])
    np.testing.assert_allclose(fitted.predict_log_proba(logits[:6].reshape(2, 3, 3)), rows.reshape(2, 3, 3))
    np.testing.assert_allclose(fitted.predict_log_proba(logits[0]), rows[0], rtol=1e-14)
    np.testing.assert_array_equal(fitted.predict_proba(logits[:6]), np.exp(rows))


@every_calibration
@pytest.mark.parametrize(
    ("logits", "labels", "status"),
    [
        (np.eye(3), [0, 1, 2], "separable"),
        (np.eye(3)[[0, 1]], [0, 1], "separable"),  # and a shape is missing
        (np.eye(3)[[0, 0]], [0, 0], "separable"),  # one shape, always the likeliest
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]], [0, 0, 0], "ok"),  # one shape, not always
        (np.ones((3, 3)), [0, 1, 2], "uninformative"),
        (1e308 * np.ones((3, 3)), [0, 0, 2], "uninformative"),
        (np.eye(3), [1, 2, 0], "anti_informative"),
        ([[1e308, -1e308, 0.0]], [0], "separable"),
        ([[1e308, -1e308, 0.0]], [1], "anti_informative"),
        ([[5e-324, 0.0, 0.0]], [0], "separable"),
        ([[0.0, 0.0, 0.0]], [1], "uninformative"),
        ([[1.0, 0.0], [1.0, 0.0]], [0, 1], "uninformative"),
        ([[0.1, -0.1, 0.6]] * 3, [0, 1, 2], "uninformative"),
    ],
)
def test_data_without_an_ordinary_optimum_get_a_status_and_finite_probabilities(name, logits, labels, status):
    fitted = CALIBRATIONS[name]().fit(logits, labels)
    assert fitted.status == status
    log_probs = fitted.predict_log_proba(logits)
    assert_distributions(log_probs)
    assert log_probs.min() > -40.0  # floored: no touch is worth more than that
    extremes = np.array([[1e308, -1e308, 0.0], [5e-324, 0.0, 0.0]])
    assert_distributions(fitted.predict_log_proba(extremes[:, : log_probs.shape[1]]))


@every_calibration
def test_a_single_shape_is_certain(name):
    fitted = CALIBRATIONS[name]().fit([[3.0], [-1.0]], [0, 0])
    assert fitted.predict_proba([[7.0]]).tolist() == [[1.0]]


finite = st.sampled_from(ODD_NUMBERS) | st.floats(allow_nan=False, allow_infinity=False)
any_logits = arrays(np.float64, (5, 3), elements=finite) | arrays(np.float64, (5, 3), elements=st.floats())


def narrowed(numbers, dtype):
    with np.errstate(over="ignore"):
        return numbers.astype(dtype)


@every_calibration
@given(
    logits=st.builds(narrowed, any_logits, st.sampled_from([np.float16, np.float32, np.float64])),
    labels=arrays(np.int64, 5, elements=st.integers(0, 2)),
)
def test_whatever_the_numbers_there_is_an_error_or_a_distribution(name, logits, labels):
    calibration = CALIBRATIONS[name]()
    if not np.isfinite(logits).all():
        with pytest.raises(ValueError, match="not finite"):
            calibration.fit(logits, labels)
        with pytest.raises(ValueError, match="not finite"):
            calibration.predict_proba(logits)
        return
    fitted = calibration.fit(logits, labels)
    for some in (calibration, fitted):
        assert_distributions(some.predict_log_proba(logits))
        assert_distributions(some.predict_log_proba(-logits))
    value, gradient = fitted.objective(logits, labels)
    assert not np.isnan(value)
    assert not np.isnan(gradient).any()
    assert fitted.from_fields(fitted.to_fields()).to_fields() == fitted.to_fields()


@every_calibration
@settings(max_examples=60)
@given(
    logits=arrays(np.float64, (6, 3), elements=st.sampled_from(ODD_NUMBERS)),
    labels=arrays(np.int64, 6, elements=st.integers(0, 2)),
)
def test_mixed_scales_in_one_table_are_fitted_too(name, logits, labels):
    fitted = CALIBRATIONS[name]().fit(logits, labels)
    assert_distributions(fitted.predict_log_proba(logits))


@every_calibration
@pytest.mark.parametrize(
    ("logits", "labels", "message"),
    [
        (np.zeros((0, 3)), np.zeros(0, int), r"n ≥ 1, got \(0, 3\)"),
        (np.zeros((2, 0)), [0, 0], "n ≥ 1"),
        (np.zeros(3), [0], "need logits"),
        ([[0.0, 1.0], [0.0, np.nan]], [0, 1], r"row 1 \(from 0\) are not finite"),
        ([[-np.inf, 1.0]], [0], r"row 0 \(from 0\) are not finite"),
        ([[0.0, 1.0], [0.0, 1.0]], [0, 2], r"integers in \[0, 2\), got 2 in row 1"),
        ([[0.0, 1.0]], [-1], "got -1 in row 0"),
        ([[0.0, 1.0]], [0.0], "got float64"),
        ([[0.0, 1.0]], [0, 1], "need logits"),
    ],
)
def test_bad_data_are_refused_with_the_reason(name, logits, labels, message):
    with pytest.raises(ValueError, match=message):
        CALIBRATIONS[name]().fit(logits, labels)


@every_calibration
@pytest.mark.parametrize("weights", [[0.0, 0.0], [1.0, -1.0], [np.nan, 1.0], [np.inf, 1.0], [1.0], "ab"])
def test_weights_that_are_none_are_refused(name, weights):
    with pytest.raises(ValueError, match="weight"):
        CALIBRATIONS[name]().fit(np.eye(2) - 0.5, [0, 1], weights)


def test_logits_of_certain_probabilities_are_as_sure_as_the_floor_allows():
    np.testing.assert_allclose(logits_from_probs([0.0, 1.0], floor=1e-6)[:, 1], [np.log(1e-6), 0.0])
    for probs in ([1.5], [[np.nan, 1.0]]):
        with pytest.raises(ValueError, match=r"1\.5|nan"):
            logits_from_probs(probs)


@every_calibration
@pytest.mark.parametrize(
    ("logits", "message"),
    [(np.zeros((0, 3)), "none of the axes empty"), (1.0, "need logits"), ([[np.nan] * 3], "row 0 .* are not finite")],
)
def test_what_cannot_be_predicted_is_refused(name, rng, logits, message):
    fitted = CALIBRATIONS[name]().fit(*sample(rng))
    with pytest.raises(ValueError, match=message):
        fitted.predict_proba(logits)


@every_calibration
def test_a_calibration_comes_back_from_its_fields_to_the_last_bit(name, rng):
    logits, labels = sample(rng)
    fitted = CALIBRATIONS[name]().fit(logits, labels)
    again = type(fitted).from_fields(json.loads(json.dumps(fitted.to_fields())))
    assert again.status == fitted.status
    np.testing.assert_array_equal(again.predict_log_proba(logits), fitted.predict_log_proba(logits))


FORMS = {
    "exact": lambda p: p,
    "single precision": np.float32,
    "half precision": np.float16,
    "four decimals": lambda p: p.round(4),
    "three decimals": lambda p: p.round(3),
    "two decimals": lambda p: p.round(2),
    "two decimals in single precision": lambda p: p.round(2).astype(np.float32),
    "percentages": lambda p: 100.0 * p,
    "percentages, two decimals": lambda p: (100.0 * p).round(2),
    "percentages, one decimal": lambda p: (100.0 * p).round(1),
    "whole percentages": lambda p: (100.0 * p).round().astype(int),
}
MODEL = random_model(np.random.default_rng(0), num_shapes=3, num_poses=1)
TAKE_LOGITS = {
    "fit": lambda z, y: CALIBRATIONS["vector"]().fit(z, y),
    "fit with weights": lambda z, y: CALIBRATIONS["temperature"]().fit(z, y, np.ones(300)),
    "fit by pose": lambda z, y: PerPose().fit(z, y, 0 * y),
    "predict_proba": lambda z, y: CALIBRATIONS["temperature"](2.0, "ok").predict_proba(z),
    "predict_log_proba": lambda z, y: CALIBRATIONS["dirichlet"]().predict_log_proba(z),
    "predict by pose": lambda z, y: PerPose().fit(np.log(z + 1e-3), y, 0 * y).predict_log_proba(z, 0 * y),
    "fit_observation_model": lambda z, y: fit_observation_model(z, y, y + 3 * (np.arange(300) // 30)),
    "calibration_of_stops": lambda z, y: calibration_of_stops(MODEL, z, y, np.arange(300), 0.4),
    "certified_stops": lambda z, y: certified_stops(MODEL, z, y, np.arange(300), 0.5),
    "a touch": lambda z, y: Touch(0, z[0]),
    "Belief.update": lambda z, y: Belief.uniform(["x", "y", "z"]).update(z[0]),
}


@pytest.mark.parametrize(
    ("name", "form"),
    [
        *(("a touch", form) for form in FORMS),
        *((name, "two decimals") for name in TAKE_LOGITS if name != "fit_observation_model"),
        pytest.param("fit_observation_model", "two decimals", marks=pytest.mark.nightly),
    ],
)
@pytest.mark.filterwarnings("error")
def test_no_form_of_probabilities_is_taken_for_logits_in_silence(name, form, rng):
    logits, labels = sample(rng)
    probs = FORMS[form](np.exp(log_softmax(logits, axis=1)))
    with pytest.warns(UserWarning, match=r"no negative number and sums to (one|100), as p.* do; ") as caught:
        TAKE_LOGITS[name](probs, labels)
    assert caught[0].filename == __file__


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "row", [[0.2, 0.7], [0.2, 0.800_1], [8.0, 2.0], [0.0, 1.0], [0.125, 0.874_99], [60.0, 39.0], [1e308, 1e308], [50.5]]
)
def test_a_touch_whose_logits_only_resemble_probabilities_is_no_mistake(row):
    assert Touch(0, row).logits.tolist() == row


@pytest.mark.parametrize("labels", [[1] * 20, [0]])
def test_labels_of_one_shape_are_said_to_tell_nothing_about_the_others(labels, rng):
    logits, labels = rng.normal(size=(len(labels), 3)), np.array(labels)
    for call in (
        *(lambda kind=kind: kind().fit(logits, labels) for kind in CALIBRATIONS.values()),
        lambda: PerPose().fit(logits, labels, 0 * labels),
    ):
        with pytest.warns(UserWarning, match=rf"all \d+ labels are {labels[0]}: .* nothing about the other 2"):
            call()
