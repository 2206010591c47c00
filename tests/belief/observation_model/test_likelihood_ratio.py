"""The calibrated ratio: Bayes' rule read backwards, and what repeats are worth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belief import Touch
from belief.calibration import CALIBRATIONS, TemperatureScaling
from belief.observation_model import OutcomeTable, RatioModel, read_observation_model
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.repeat_discount import effective_touches, fit_correlation, new_shares, repeats
from belief.observation_model.selection import log_posteriors
from belief.touch_batch import TouchBatch

LABELS = ("ball", "cube", "cone")
PRIOR = np.array([0.5, 0.3, 0.2])


def ratio(correlation=0.4, num_references=200, prior=PRIOR):
    references = 2.0 * np.random.default_rng(0).normal(size=(2, num_references, 3))
    return RatioModel(LABELS, TemperatureScaling(1.5, "ok"), prior, correlation, references)


def test_one_touch_says_its_calibrated_posterior_over_the_training_prior(rng):
    model = ratio()
    batch = TouchBatch(np.array([[0], [1]]), rng.normal(size=(2, 1, 3)))
    expected = np.log(model.calibration.predict_proba(batch.logits[:, 0]) / PRIOR)
    np.testing.assert_allclose(model.log_likelihood_batch(batch), expected, rtol=1e-12)
    # Under the prior of the training, the posterior is what the calibration says.
    probs = np.exp(expected) * PRIOR
    np.testing.assert_allclose(
        probs / probs.sum(axis=1, keepdims=True), model.calibration.predict_proba(batch.logits[:, 0])
    )


def test_without_correlation_log_ratios_add_up(rng):
    batch = TouchBatch(rng.integers(2, size=(9, 6)), rng.normal(size=(9, 6, 3)))
    model = ratio(correlation=0.0)
    expected = np.log(model.calibration.predict_proba(batch.logits) / PRIOR).sum(axis=1)
    np.testing.assert_allclose(model.log_likelihood_batch(batch), expected, rtol=1e-12)


def test_touches_in_one_pose_count_as_so_many_of_their_mean(rng):
    model = ratio(correlation=0.4)
    batch = TouchBatch(np.array([[0, 1, 0, 0]]), rng.normal(size=(1, 4, 3)))
    log_ratio = np.log(model.calibration.predict_proba(batch.logits[0]) / PRIOR)
    expected = 3 / (1 + 2 * 0.4) * log_ratio[[0, 2, 3]].mean(axis=0) + log_ratio[1]
    np.testing.assert_allclose(model.log_likelihood_batch(batch)[0], expected, rtol=1e-12)


@given(st.integers(1, 10**6), st.floats(0.0, 1.0))
def test_repeats_are_worth_between_one_touch_and_as_many(n, correlation):
    worth = float(effective_touches(n, correlation))
    assert 1.0 - 1e-12 <= worth <= n + 1e-9
    assert worth <= 1.0 / max(correlation, 1e-300) + 1e-9
    # One more never takes away, and the variance of a mean of equally correlated touches is 1 over that.
    assert effective_touches(n + 1, correlation) >= worth - 1e-9
    if n <= 40:
        covariance = (1.0 - correlation) * np.eye(n) + correlation
        assert 1.0 / covariance.mean() == pytest.approx(worth)


def test_no_touches_are_worth_nothing():
    assert effective_touches(0, 0.5) == 0.0


def correlated(rng, correlation, num_objects=900, rounds=4, num_shapes=3):
    """Logits of d' = 2 whose noise in one pose correlates, shapes and ids."""
    shapes = np.arange(num_objects) % num_shapes
    shared = rng.normal(size=(num_objects, 1, 2, 3))
    noise = np.sqrt(correlation) * shared + np.sqrt(1.0 - correlation) * rng.normal(size=(num_objects, rounds, 2, 3))
    logits = 1.5 * np.eye(3)[shapes][:, None, None] + noise
    touches = [Touch(pose, logits[i, j, pose]) for i in range(num_objects) for j in range(rounds) for pose in range(2)]
    return touches, shapes.repeat(2 * rounds), np.arange(num_objects).repeat(2 * rounds)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.7, 1.0])
def test_fitting_finds_how_far_touches_repeat(correlation, rng):
    # Gaussian noise of equal covariance: log ratios are linear in the logits, so the discount is exact.
    model = RatioModel.fit(*correlated(rng, correlation))
    assert model.status == "ok"
    assert model.correlation == pytest.approx(min(correlation, 0.999), abs=0.05)


def test_claims_about_repeated_touches_are_right_where_adding_up_is_not(rng):
    model = RatioModel.fit(*correlated(rng, 0.6))
    touches, shapes, _ = correlated(rng, 0.6, num_objects=3000)
    batch = TouchBatch.of([[touch for touch in touches[8 * i : 8 * i + 8] if touch.pose == 0] for i in range(3000)])
    naive = RatioModel(model.shape_labels, model.calibration, model.training_prior, 0.0, model.references)
    gaps = []
    for some in (model, naive):
        probs = np.exp(log_posteriors(some, batch))
        gaps.append(probs.max(axis=1).mean() - (probs.argmax(axis=1) == shapes[::8]).mean())
    # 3 000 objects, two thirds of them right: standard error .008.
    assert abs(gaps[0]) < 0.025
    assert gaps[1] > 0.08


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_any_calibration_will_do(name, rng):
    model = RatioModel.fit(*correlated(rng, 0.5, num_objects=300), calibration=CALIBRATIONS[name]())
    assert model.calibration.name == name
    again = read_observation_model(model.to_json())
    batch = TouchBatch(np.array([[0, 1, 1]]), rng.normal(size=(1, 3, 3)))
    np.testing.assert_array_equal(again.log_likelihood_batch(batch), model.log_likelihood_batch(batch))


def test_the_discount_is_fitted_to_objects_the_calibration_has_not_seen(rng):
    # Nine objects: a calibration of its own touches would believe every one of them.
    class Counting(TemperatureScaling):
        seen: list = []  # noqa: RUF012

        def fit_logits(self, logits, labels, weights=None):
            self.seen.append(len(logits))
            return super().fit_logits(logits, labels)

    RatioModel.fit(*correlated(rng, 0.5, num_objects=9), calibration=Counting(), num_folds=3)
    assert sorted(Counting.seen) == [48, 48, 48, 72]


def test_one_object_touched_ten_thousand_times_among_others_is_no_trouble(rng):
    touches, shapes, ids = correlated(rng, 0.5, num_objects=300)
    extra = [Touch(0, row) for row in np.array([1.5, 0.0, 0.0]) + rng.normal(size=(10_000, 3))]
    model = RatioModel.fit(
        touches + extra, np.append(shapes, np.zeros(10_000, int)), np.append(ids, np.full(10_000, 999))
    )
    assert model.status == "ok"


@pytest.mark.parametrize(("num_shapes", "rounds", "status"), [(3, 1, "no_repeats"), (1, 4, "one_shape")])
def test_what_is_not_known_of_repeats_is_assumed_and_said(num_shapes, rounds, status, rng):
    model = RatioModel.fit(*correlated(rng, 0.5, num_objects=30, rounds=rounds, num_shapes=num_shapes))
    assert (model.status, model.correlation) == (status, 0.5)


def test_a_shape_never_seen_is_neither_favoured_nor_ruled_out(rng):
    touches, shapes, ids = correlated(rng, 0.5, num_shapes=2)
    model = RatioModel.fit(touches, shapes, ids)
    batch = TouchBatch.of([[touch] for touch in touches])
    likelihoods = np.exp(model.log_likelihood_batch(batch))
    np.testing.assert_allclose(likelihoods.mean(axis=0), 1.0, atol=0.05)
    assert (likelihoods[:, 2] > 0.0).all()


def test_samples_are_references_as_often_as_they_speak_for_the_shape(rng):
    model = ratio(num_references=5)
    weights = model.calibration.predict_proba(model.references)[1, :, 2]
    drawn = model.sample_batch(2, np.ones((20_000, 1), int), rng).logits[:, 0]
    found = [(drawn == reference).all(axis=1).mean() for reference in model.references[1]]
    np.testing.assert_allclose(found, weights / weights.sum(), atol=0.015)  # four standard errors


def test_the_table_tells_nearly_all_that_references_tell_and_never_more():
    model = ratio(num_references=400, prior=np.full(3, 1 / 3))
    probs = model.calibration.predict_proba(model.references)
    every = OutcomeTable(np.swapaxes(probs / probs.sum(axis=1, keepdims=True), 1, 2)).information()
    told = [model.outcome_table(m).information() for m in (2, 6, 12, 36)]
    assert all((some <= every + 1e-3).all() for some in told)
    means = [some.mean() for some in told]
    assert means == sorted(means)
    assert means[-1] > 0.95 * every.mean()  # the rest goes to shrinking poses towards each other


def test_very_many_touches_of_one_object_are_worth_at_most_one_over_the_correlation(rng):
    model = ratio(correlation=0.4)
    batch = TouchBatch(np.zeros((1, 300_000), int), rng.normal(size=(1, 300_000, 3)))
    mean = np.log(model.calibration.predict_proba(batch.logits[0]) / PRIOR).mean(axis=0)
    np.testing.assert_allclose(model.log_likelihood_batch(batch)[0], mean / 0.4, rtol=1e-5)


def test_correlation_is_the_one_of_least_loss():
    touches = [Touch(0, np.zeros(2))] * 8
    found = repeats(LabelledTouches.of(touches, [0, 0, 1, 1] * 2, [0, 0, 1, 1, 2, 2, 3, 3]))
    truth = found.shapes[:, None, None] == np.arange(2)

    def log_likelihoods(correlation):  # best at a correlation of .3
        return np.where(truth, -(((correlation - 0.3) * 10.0) ** 2), 0.0)

    assert fit_correlation(log_likelihoods, found) == pytest.approx(0.3, abs=1e-3)
    assert fit_correlation(lambda correlation: np.where(truth, correlation, 0.0), found) == 0.999
    assert fit_correlation(lambda correlation: np.where(truth, -correlation, 0.0), found) == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"training_prior": np.array([0.5, 0.5, 0.0])}, "positive shares"),
        ({"training_prior": np.array([0.5, 0.5])}, "3 positive shares"),
        ({"training_prior": np.array([0.5, 0.5, np.nan])}, "positive shares"),
        ({"correlation": 1.0}, r"in \[0, 1\)"),
        ({"correlation": np.nan}, r"in \[0, 1\)"),
        ({"references": np.zeros((1, 0, 3))}, "references must be"),
        ({"references": np.full((1, 2, 3), np.inf)}, "finite"),
        ({"calibration": CALIBRATIONS["vector"]().fit(2.0 * np.eye(2), [0, 1])}, "for 2 shapes"),
        ({"status": "fine"}, "status must be one of"),
    ],
)
def test_what_cannot_be_is_refused(change, message):
    model = ratio()
    names = ("shape_labels", "calibration", "training_prior", "correlation", "references", "status")
    with pytest.raises(ValueError, match=message):
        RatioModel(**{**{name: getattr(model, name) for name in names}, **change})


def test_groups_of_repeats_are_those_of_loops_over_objects_and_poses(rng):
    objects, poses = rng.integers(5, size=60), rng.choice(3, 60, p=[0.8, 0.15, 0.05])  # groups of many sizes
    data = LabelledTouches.of([Touch(int(pose), np.zeros(3)) for pose in poses], objects % 3, objects, LABELS, 3)
    expected = {}
    for index, pair in enumerate(zip(objects.tolist(), poses.tolist(), strict=True)):
        expected.setdefault(pair, []).append(index)
    expected = sorted((rows[:12], pair[0] % 3) for pair, rows in expected.items() if len(rows) > 1)
    found = repeats(data)
    assert (found.rows >= -1).all()
    assert sorted(([i for i in rows if i >= 0], k) for rows, k in zip(*map(np.ndarray.tolist, found), strict=True)) == (
        expected
    )


@pytest.mark.parametrize(("correlation", "drift"), [(0.0, 0.0), (0.4, 0.0), (0.4, 0.1), (1.0, 1.0)])
def test_a_new_touch_is_worth_by_how_much_it_raises_the_effective_number(correlation, drift, rng):
    def effective(counts):
        return effective_touches(sum(effective_touches(number, correlation) for number in counts), drift)

    counts = rng.integers(4, size=(3, 4, 5))
    shares = new_shares(counts, correlation, drift)
    for index in np.ndindex(counts.shape):
        before, after = counts[index[:-1]], counts[index[:-1]] + (np.arange(5) == index[-1])
        assert shares[index] == pytest.approx(min(effective(after) - effective(before), 1.0), abs=1e-12)


def test_a_constant_added_to_the_logits_of_a_reference_changes_no_table(rng):
    model = ratio()
    moved = replace(model, references=model.references + rng.uniform(-300.0, 300.0, (2, 200, 1)))
    np.testing.assert_allclose(moved.outcome_table().probs, model.outcome_table().probs, atol=1e-9)
