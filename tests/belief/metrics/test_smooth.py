"""The smooth calibration error against the sum over kernels that defines it."""

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from belief.metrics import smooth_calibration_error


def error_of_width(confidence, correct, width, num_points=20_000):
    """∫ |mean of K_σ(t, c) (c - correct)| dt with the kernel written out: a Gaussian and its mirror images."""
    t = (np.arange(num_points) + 0.5) / num_points
    height = np.zeros(num_points)
    for c, right in zip(confidence, correct, strict=True):
        for image in range(-4, 5):
            for source in (2 * image + c, 2 * image - c):
                height += stats.norm.pdf(t, source, width) * (c - right)
    return np.abs(height / len(confidence)).mean()


def two_shapes(confidence, correct):
    return np.column_stack([confidence, 1.0 - confidence]), np.where(correct, 0, 1)


@pytest.mark.parametrize("sharpness", [0.3])
def test_it_is_the_fixed_point_of_the_sum_over_kernels(sharpness, rng):
    confidence = 0.5 + 0.5 * rng.random(25) ** (1 / sharpness)
    correct = rng.random(25) < 0.5 + 0.5 * (confidence - 0.5)
    expected = brentq(lambda width: error_of_width(confidence, correct, width, 2000) - width, 5e-3, 2.0)
    assert smooth_calibration_error(*two_shapes(confidence, correct)) == pytest.approx(expected, rel=1e-5)


def test_a_small_error_is_a_fixed_point_too():
    # Gaps that nearly cancel at distances of .001: the width must become so small before they are told apart.
    confidence = np.repeat(0.7 + 0.002 * np.arange(4), 1000)
    right = np.array([690, 712, 694, 716])
    correct = np.arange(1000) < right[:, None]
    result = smooth_calibration_error(*two_shapes(confidence, correct.ravel()))
    assert 1e-4 < result < 5e-3
    gaps, centres = confidence.reshape(4, -1)[:, 0] - right / 1000, confidence.reshape(4, -1)[:, 0]
    t = np.linspace(0.6, 0.8, 400_001)  # nothing else in reach
    height = sum(gap / 4 * stats.norm.pdf(t, centre, result) for gap, centre in zip(gaps, centres, strict=True))
    assert np.abs(height).sum() * (t[1] - t[0]) == pytest.approx(result, rel=1e-4)


@pytest.mark.parametrize("gap", [1.0, 0.5, 1e-3, 1e-6, 1e-12])
def test_gaps_that_are_all_alike_are_the_error_at_any_width(gap):
    # Confidence 1 - gap and always right; or, for 1, sure and always wrong.
    confidence, correct = (np.ones(5), np.zeros(5, bool)) if gap == 1.0 else (np.full(5, 1.0 - gap), np.ones(5, bool))
    assert smooth_calibration_error(*two_shapes(confidence, correct)) == pytest.approx(gap, rel=1e-3)


def test_a_step_over_the_edge_of_a_bin_is_a_small_step(rng):
    correct = np.arange(40) % 2 == 0
    below, above = np.full(40, 0.6), np.where(correct, 0.6, 0.6 + 1e-9)
    step = smooth_calibration_error(*two_shapes(above, correct)) - smooth_calibration_error(*two_shapes(below, correct))
    assert abs(step) < 1e-8


def test_it_is_no_smaller_than_the_mean_gap_and_no_larger_than_the_mean_size_of_gaps(rng):
    for _ in range(50):
        confidence, correct = 0.5 + 0.5 * rng.random(30), rng.random(30) < 0.6
        gaps = confidence - correct
        assert abs(gaps.mean()) - 1e-9 <= smooth_calibration_error(*two_shapes(confidence, correct))
        assert smooth_calibration_error(*two_shapes(confidence, correct)) <= np.abs(gaps).mean()
