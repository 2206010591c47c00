"""The likelihood of a reading agrees with closed forms."""

import numpy as np
import pytest
from scipy import stats

from activetouch.rendering import DeadTaxels, Gain, Noise, Quantisation, read_out
from benchmarks.bayes_error.evidence import log_posterior
from benchmarks.bayes_error.noise import SensorNoise, UnknownLikelihood

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
    found = noise.log_mean_likelihoods(readings, means[:, None])
    likely = expected > -60.0  # relative errors of tails beyond do not decide anything
    np.testing.assert_allclose(found[likely], expected[likely], atol=5e-3)


def test_two_known_images_are_told_apart_as_often_as_theory_says(rng):
    # d = ‖difference‖ / σ = 2, so the best reader is right Φ(1) = 0.841 of the time; 8 000 guesses have a standard
    # error of 0.004, so 0.02 is exceeded with probability 1e-6.
    images = np.stack([np.full((2, 2), 0.5), np.full((2, 2), 0.55)])
    readings = np.concatenate([readings_of(image, 0.05, 4000, rng) for image in images])
    noise = SensorNoise(0.0, 0.05, ALL_LIVE)
    log_likelihood = noise.log_mean_likelihoods(readings, images.reshape(2, 1, 4))
    right = log_posterior(log_likelihood).argmax(axis=1) == np.repeat([0, 1], 4000)
    assert right.mean() == pytest.approx(stats.norm.cdf(1.0), abs=0.02)
    # The posterior is true, so what it expects is what it gets.
    assert np.exp(log_posterior(log_likelihood).max(axis=1)).mean() == pytest.approx(right.mean(), abs=0.02)


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
