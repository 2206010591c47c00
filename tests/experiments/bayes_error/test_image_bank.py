"""Simulated Bayes agrees with closed forms, and its law is that of the sensor."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from activetouch.errors import UnknownLikelihood
from activetouch.named_scenes import SCENES
from activetouch.pressing.press import Quasistatic
from activetouch.rendering import DeadTaxels, Gain, Noise, Quantisation, read_out
from activetouch.scene import Symmetry
from experiments.bayes_error.image_bank import (
    SensorNoise,
    ideal_symmetry,
    log_evidence_of_slice,
    log_posterior,
    pool,
    symmetric_views,
)

ALL_LIVE = np.ones((2, 2), bool)


def exact_log_likelihood(readings, means, std):
    """By the normal distribution's own function, taxel by taxel: (N, B)."""
    levels, centre = readings.reshape(len(readings), 1, -1).astype(float), 255.0 * means[None]
    upper = np.where(levels == 255, np.inf, levels + 0.5)
    lower = np.where(levels == 0, -np.inf, levels - 0.5)
    high, low = ((edge - centre) / (255.0 * std) for edge in (upper, lower))
    # Of the two tails the smaller is exact.
    mass = np.where(low > 0.0, stats.norm.sf(low) - stats.norm.sf(high), stats.norm.cdf(high) - stats.norm.cdf(low))
    return np.log(mass).sum(axis=2)


def readings_of(image, std, count, rng):
    return np.stack([read_out(image, (Noise(std),), rng) for _ in range(count)])


def test_the_likelihood_is_the_censored_gaussian(rng):
    means = rng.uniform(-0.1, 1.1, (5, 4)).clip(0.0, 1.05)
    readings = np.concatenate([readings_of(mean.reshape(2, 2), 0.05, 20, rng) for mean in means])
    assert {0, 255} <= set(readings.ravel().tolist()), "both ends of the range are to be tested"
    noise = SensorNoise(0.0, 0.05, ALL_LIVE)
    expected = exact_log_likelihood(readings, means, 0.05)
    found = np.stack([noise.log_sum_likelihood(readings, mean[None]) for mean in means], axis=1)
    likely = expected > -60.0  # relative errors of tails beyond do not decide anything
    np.testing.assert_allclose(found[likely], expected[likely], atol=5e-3)


def test_the_probabilities_of_all_levels_sum_to_one():
    noise = SensorNoise(0.0, 0.05, np.ones((1, 1), bool))
    levels = np.arange(256, dtype=np.uint8).reshape(256, 1, 1)
    for mean in (0.0, 0.02, 0.5, 1.0, 1.1):
        assert np.exp(noise.log_sum_likelihood(levels, np.array([[mean]]))).sum() == pytest.approx(1.0, abs=1e-3)


def test_two_known_images_are_told_apart_as_often_as_theory_says(rng):
    # d = ‖difference‖ / σ = 2, so the best reader is right Φ(1) = .841 of the time; 8 000 guesses have a standard
    # error of .004, so .02 is exceeded with probability 1e-6.
    images = np.stack([np.full((2, 2), 0.5), np.full((2, 2), 0.55)])
    readings = np.concatenate([readings_of(image, 0.05, 4000, rng) for image in images])
    noise = SensorNoise(0.0, 0.05, ALL_LIVE)
    log_likelihood = np.stack([noise.log_sum_likelihood(readings, image.reshape(1, 4)) for image in images], axis=1)
    right = log_posterior(log_likelihood).argmax(axis=1) == np.repeat([0, 1], 4000)
    assert right.mean() == pytest.approx(stats.norm.cdf(1.0), abs=0.02)
    # The posterior is true, so what it expects is what it gets.
    assert np.exp(log_posterior(log_likelihood).max(axis=1)).mean() == pytest.approx(right.mean(), abs=0.02)


def test_more_noise_leaves_fewer_right(rng):
    # Closed forms .99, .83, .63; 2 000 guesses each have a standard error below .011, so the order cannot fail.
    images, accuracies = np.stack([np.full((2, 2), 0.4), np.full((2, 2), 0.5)]), []
    for std in (0.04, 0.1, 0.3):
        readings = np.concatenate([readings_of(image, std, 1000, rng) for image in images])
        noise = SensorNoise(0.0, std, ALL_LIVE)
        log_likelihood = np.stack([noise.log_sum_likelihood(readings, image.reshape(1, 4)) for image in images], 1)
        accuracies.append(np.mean(log_likelihood.argmax(axis=1) == np.repeat([0, 1], 1000)))
    assert accuracies[0] > accuracies[1] > accuracies[2] > 0.5


def test_a_mean_over_images_is_the_mean_of_their_likelihoods(rng):
    means = rng.uniform(0.0, 1.0, (2100, 4))  # more than one block of each
    readings = rng.integers(0, 256, (260, 2, 2), np.uint8)
    noise = SensorNoise(0.0, 0.2, ALL_LIVE)
    expected = np.logaddexp.reduce(exact_log_likelihood(readings, means, 0.2), axis=1)
    np.testing.assert_allclose(noise.log_sum_likelihood(readings, means), expected, atol=5e-3)


def test_slices_pool_to_their_mean(rng):
    parts = rng.normal(size=(4, 7, 3))
    np.testing.assert_allclose(pool(parts), np.log(np.exp(parts).mean(axis=0)))


def test_relabelling_shapes_permutes_the_posterior(rng):
    evidence, order = rng.normal(size=(5, 3)), [2, 0, 1]
    np.testing.assert_allclose(log_posterior(evidence[:, order]), log_posterior(evidence)[:, order])


def test_readings_no_bank_explains_stay_finite():
    noise = SensorNoise(0.1, 0.05, ALL_LIVE)
    for level in (0, 255):
        for mean in (0.0, 1.1):
            found = noise.log_sum_likelihood(np.full((1, 2, 2), level, np.uint8), np.full((1, 4), mean))
            assert np.isfinite(found).all()


def test_a_dead_taxel_says_nothing(rng):
    faults = (Gain(0.1), Noise(0.05), DeadTaxels(0.25, seed=3))
    noise = SensorNoise.of(faults, 2)
    assert noise.live.sum() == 3
    readings = rng.integers(0, 256, (10, 2, 2), np.uint8)
    other = np.where(noise.live, readings, 17).astype(np.uint8)
    means = noise.sample_means(rng.uniform(size=(20, 2, 2)), rng)
    np.testing.assert_array_equal(noise.log_sum_likelihood(readings, means), noise.log_sum_likelihood(other, means))


def test_gains_of_the_bank_are_those_of_the_fault(rng):
    noise, ideals = SensorNoise.of((Gain(0.3), Noise(0.05)), 2), rng.uniform(0.1, 1.0, size=(4000, 2, 2))
    gains = noise.sample_means(ideals, rng) / ideals.reshape(4000, 4)
    np.testing.assert_allclose(gains, np.broadcast_to(gains[:, :1], gains.shape))  # one for each image
    assert stats.kstest(gains[:, 0], stats.uniform(0.7, 0.6).cdf).pvalue > 1e-6


@pytest.mark.parametrize(
    "faults",
    [
        (),
        (Gain(0.1),),
        (Noise(0.0),),
        (Noise(0.05), Gain(0.1)),
        (Noise(0.05), Quantisation(4)),
        (DeadTaxels(0.5), Noise(0.05)),
    ],
)
def test_a_sensor_without_a_closed_form_is_refused(faults):
    with pytest.raises(UnknownLikelihood, match="got"):
        SensorNoise.of(faults, 2)


def test_there_are_as_many_views_as_symmetries(rng):
    images = rng.uniform(size=(3, 4, 4))
    for symmetry, count in zip(Symmetry, (1, 4, 8), strict=True):
        views = symmetric_views(images, symmetry)
        assert views.shape == (3, count, 4, 4)
        np.testing.assert_array_equal(views[:, 0], images)
        assert len(np.unique(views[0].reshape(count, -1), axis=0)) == count


def test_dead_taxels_do_not_break_the_symmetry_of_ideal_images():
    scene = SCENES["coarse"].scene
    assert scene.symmetry is Symmetry.NONE
    assert ideal_symmetry(scene) is Symmetry.ROTATIONS_AND_MIRROR


def test_a_pose_that_aims_beside_the_middle_breaks_the_symmetry_of_ideal_images():
    scene = replace(SCENES["coarse"].scene, aims={"front": (0.005, 0.0)})
    assert ideal_symmetry(scene) is Symmetry.NONE


def test_a_turned_reading_is_as_likely_where_no_taxel_is_dead(rng):
    scene = replace(SCENES["coarse"].scene, press_model=Quasistatic(), faults=(Noise(0.05),))
    noise = SensorNoise.of(scene.faults, 4)
    readings = rng.integers(0, 60, (5, 4, 4), np.uint8)
    turned = np.rot90(readings, axes=(1, 2))[:, :, ::-1]
    first, second = (log_evidence_of_slice(scene, noise, some, 3, 0, 0)[2] for some in (readings, turned))
    np.testing.assert_allclose(first, second, atol=5e-3)
