"""Hypotheses cover orientations and sizes evenly."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from activetouch.distributions import Constant, Uniform, quaternions, sizes
from activetouch.poses import random_orientation, to_matrices, to_matrix


@pytest.mark.parametrize("num", [1, 2, 64, 1024])
def test_rotations_are_rotations_of_the_quaternions(num):
    found = to_matrices(quaternions(num))
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (num, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1.0)
    np.testing.assert_allclose(found[-1], to_matrix(quaternions(num)[-1]))


def test_orientations_are_covered_more_evenly_than_at_random(rng):
    asked = np.array([random_orientation(rng) for _ in range(4000)])

    def angles(cover):
        distance, _ = cKDTree(np.concatenate([cover, -cover])).query(asked)
        return 4 * np.arcsin(distance / 2)

    even, chance = angles(quaternions(1024)), angles(np.array([random_orientation(rng) for _ in range(1024)]))
    assert even.max() < 0.75 * chance.max()
    assert np.rad2deg(even.max()) < 25.0


def test_moments_are_those_of_the_uniform_distribution():
    # Under Haar measure, E[R] = 0 and E[R_ij R_kl] = δ_ik δ_jl / 3.
    entries = to_matrices(quaternions(4096)).reshape(-1, 9)
    np.testing.assert_allclose(entries.mean(axis=0), 0.0, atol=2e-3)
    np.testing.assert_allclose(entries.T @ entries / len(entries), np.eye(9) / 3, atol=2e-3)
    for num in (1, 2, 7):  # w² + x² is uniform in [0, 1], so it is spread about 1 / 2
        assert np.square(quaternions(num)[:, :2]).sum() / num == pytest.approx(0.5)


def test_sizes_cover_their_range_and_do_not_follow_the_orientations():
    found = sizes(Uniform(0.75, 1.25), 1024)
    assert found.min() >= 0.75
    assert found.max() <= 1.25
    assert np.diff(np.sort(found)).max() < 5 * 0.5 / 1024
    entries = to_matrices(quaternions(1024)).reshape(
        -1, 9
    )  # 1 024 independent draws correlate by up to about 3 / √1024
    assert np.abs([np.corrcoef(found, entry)[0, 1] for entry in entries.T]).max() < 0.09
    np.testing.assert_array_equal(sizes(Constant(1.0), 4), np.ones(4))
