"""The confusion model: counting, shrinkage, and what it refuses."""

import math

import numpy as np
import pytest
from scipy import stats

from belief import Touch
from belief.calibration import TemperatureScaling
from belief.observation_model import ConfusionModel
from belief.touch_batch import TouchBatch

LABELS = ("ball", "cube", "cone")


def touches_from(table: np.ndarray, n: int, rng) -> tuple[list[Touch], np.ndarray]:
    """One-hot touches in pose 0 and 1, alternating, with the outcome frequencies of a (P, K, K) table."""
    shapes = rng.integers(table.shape[1], size=n)
    poses = np.arange(n) % 2
    outcomes = [rng.choice(table.shape[2], p=table[p, k]) for p, k in zip(poses, shapes, strict=True)]
    return [Touch(int(p), 4.0 * np.eye(table.shape[2])[m]) for p, m in zip(poses, outcomes, strict=True)], shapes


def test_fitting_recovers_the_matrix_that_made_the_data(rng):
    truth = rng.dirichlet(np.ones(3) * 2, size=(2, 3))
    touches, shapes = touches_from(truth, 6_000, rng)
    fitted = ConfusionModel.fit(touches, shapes, pooling=0.0)
    # 1 000 touches per pose and shape: standard error at most .016, six of them .095.
    np.testing.assert_allclose(fitted.probs, truth, atol=0.095)


def test_an_outcome_never_seen_is_unlikely_but_not_impossible():
    touches = [Touch(0, np.array([5.0, 0.0])), Touch(0, np.array([0.0, 5.0]))] * 50
    fitted = ConfusionModel.fit(touches, np.array([0, 1] * 50), num_poses=2)
    assert (fitted.probs > 0.0).all()
    assert fitted.probs[0, 0, 1] < 0.02
    np.testing.assert_allclose(fitted.probs[1], fitted.probs[0], atol=0.02)  # a pose never seen gets the pooled matrix


def test_a_shape_without_touches_gets_a_uniform_row():
    fitted = ConfusionModel.fit([Touch(0, np.array([3.0, 0.0, 0.0]))] * 9, np.zeros(9, int))
    np.testing.assert_allclose(fitted.probs[0, 2], 1 / 3)


@pytest.mark.parametrize(
    ("touches", "shapes", "options", "message"),
    [
        ([], [], {}, "at least one touch"),
        ([Touch(0, np.zeros(2))], [2], {}, r"\[0, 2\)"),
        ([Touch(0, np.zeros(2))], [0, 1], {}, "one shape and object for each"),
        ([Touch(0, np.array([-np.inf, 0.0]))], [0], {}, "finite logits"),
        ([Touch(0, np.zeros(1))], [0], {}, "at least two shapes"),
        ([Touch(0, np.zeros(2))], [0], {"smoothing": 0.0}, "smoothing must be > 0"),
        ([Touch(0, np.zeros(2))], [0], {"pooling": np.inf}, "both finite"),
        ([Touch(3, np.zeros(2))], [0], {"num_poses": 3}, "touch 0 has pose 3, num_poses is 3"),
        ([Touch(0, np.zeros(2))], [0], {"shape_labels": ("a",)}, "names 1"),
        ([Touch(0, np.zeros(2))], [0], {"shape_labels": ("a", "a")}, "must differ"),
    ],
)
def test_bad_calibration_data_raise_and_say_why(touches, shapes, options, message):
    with pytest.raises(ValueError, match=message):
        ConfusionModel.fit(touches, np.array(shapes, int), **options)


@pytest.mark.parametrize("labels", [("a",), ()])
def test_a_model_of_one_shape_is_refused(labels):
    with pytest.raises(ValueError, match="at least two shapes"):
        ConfusionModel(labels, np.ones((1, 1, 1)), TemperatureScaling())


@pytest.mark.parametrize("calibration", [TemperatureScaling(2.5, "ok"), TemperatureScaling(1e-6, "separable", 0.01)])
def test_samples_have_the_outcome_frequencies_of_the_table(calibration, rng):
    # Pearson's chi-square on 4 000 samples; a right model fails with probability 1e-4, the seed is fixed.
    table = rng.dirichlet(np.ones(3), size=(2, 3))
    touches = ConfusionModel(LABELS, table, calibration).sample(1, [1] * 4000, rng)
    observed = np.bincount([touch.logits.argmax() for touch in touches], minlength=3)
    assert stats.chisquare(observed, table[1, 1] * 4000).pvalue > 1e-4


def test_a_million_touches_of_one_object_are_summed_to_rounding(rng):
    table = rng.dirichlet(np.ones(3), size=(2, 3))
    model = ConfusionModel(LABELS, table, TemperatureScaling(1.0, "ok"))
    poses, outcomes = rng.integers(2, size=10**6), rng.integers(3, size=10**6)
    found = model.log_likelihood_batch(TouchBatch(poses[None], np.eye(3)[outcomes][None]))[0]
    exact = [math.fsum(np.log(table[poses, k, outcomes]).tolist()) for k in range(3)]
    np.testing.assert_allclose(found, exact, atol=1e-6)
