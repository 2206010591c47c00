"""Clusters of touches, and the tables made of them."""

import itertools
import tracemalloc

import numpy as np
import pytest
from scipy.special import softmax

from belief.observation_model import OutcomeTable
from belief.observation_model.outcome_mixture import bounded_softmax
from belief.observation_model.outcome_table import cluster, drawn, nearest, smoothed, tabulate


def log_posteriors(rng, n=300, num_shapes=3, sharpness=2.0):
    scores = sharpness * rng.normal(size=(n, num_shapes))
    return scores - np.logaddexp.reduce(scores, axis=1, keepdims=True)


def test_every_posterior_goes_to_the_centroid_of_least_divergence(rng):
    some, centroids = log_posteriors(rng), log_posteriors(rng, n=7)
    divergence = (np.exp(some)[:, None] * (some[:, None] - centroids)).sum(axis=2)
    np.testing.assert_array_equal(nearest(some, centroids), divergence.argmin(axis=1))


def test_few_touches_are_clustered_nearly_as_well_as_can_be(rng):
    # All ways to put six touches into three clusters, by the information that is kept.
    some = log_posteriors(rng, n=6)
    shares = np.exp(some) / np.exp(some).sum(axis=0)

    def kept(assigned):
        return OutcomeTable((shares.T @ np.eye(3)[list(assigned)])[None]).information()[0]

    best = max(kept(assigned) for assigned in itertools.product(range(3), repeat=6))
    found = max(kept(nearest(some, cluster(some, 3, np.random.default_rng(seed)))) for seed in range(5))
    assert 0.98 * best < found <= best + 1e-12


def test_as_many_clusters_as_touches_lose_nothing(rng):
    some = log_posteriors(rng, n=6)
    assert sorted(nearest(some, cluster(some, 6, rng))) == list(range(6))


def test_fewer_kinds_of_touches_than_clusters_are_no_trouble(rng):
    some = np.repeat(log_posteriors(rng, n=2), 10, axis=0)
    centroids = cluster(some, 5, rng)
    assert np.isfinite(centroids).all()
    assert len(np.unique(nearest(some, centroids))) == 2


@pytest.mark.parametrize("certain", [-np.inf, -1e308, -800.0])
def test_certain_posteriors_are_clustered_without_a_warning(certain, rng):
    some = np.where(np.eye(3, dtype=bool)[rng.integers(3, size=60)], 0.0, certain)
    centroids = cluster(some, 3, rng)
    assert not np.isnan(centroids).any()
    found = nearest(some, centroids)
    assert all(len(set(found[some.argmax(axis=1) == k])) == 1 for k in range(3))


def test_a_table_tells_what_its_clusters_mean_posteriors_tell(rng):
    some = log_posteriors(rng, n=400).reshape(2, 200, 3)
    shares = np.exp(some) / np.exp(some).sum(axis=1, keepdims=True)
    table = tabulate(some, shares, 4, rng)
    np.testing.assert_allclose(table.sum(axis=2), 1.0, rtol=1e-12)
    # By the data processing inequality, no more than the touches themselves.
    every = OutcomeTable(np.swapaxes(shares, 1, 2)).information()
    assert (OutcomeTable(table).information() < every).all()


def test_smoothing_leaves_no_outcome_impossible_and_moves_no_more_than_a_tenth_of_a_touch():
    table = smoothed(np.array([1.0, 0.0]), 10.0)
    np.testing.assert_allclose(table, [10.05 / 10.1, 0.05 / 10.1], rtol=1e-12)


def test_a_table_of_many_poses_takes_the_memory_of_one_pose(rng):
    posteriors = np.stack([log_posteriors(rng, n=20_000, num_shapes=2)] * 8)
    shares = np.exp(posteriors)
    shares /= shares.sum(axis=1, keepdims=True)
    tracemalloc.start()
    tabulate(posteriors, shares, 60, rng)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


def test_touches_are_drawn_as_often_as_their_weights_say_whatever_these_sum_to(rng):
    weights, poses = np.array([[1.0, 0.0, 3.0], [2.0, 2.0, 0.0]]), np.tile([0, 1], (20_000, 1))
    found = drawn(weights, poses, np.random.default_rng(0))
    for pose in (0, 1):
        shares = np.bincount(found[:, pose], minlength=3) / 20_000
        np.testing.assert_allclose(shares, weights[pose] / 4, atol=0.02)  # over five standard errors
    for scale in (1e-200, 7.0, 1e200):
        np.testing.assert_array_equal(drawn(scale * weights, poses, np.random.default_rng(0)), found)


@pytest.mark.parametrize("offset", [0.0, -1e4, 1e4])
def test_a_bounded_softmax_ignores_an_offset_and_leaves_its_argument_alone(offset):
    scores = np.array([[0.0, 0.0, -30.0], [3.0, -2.0, 1.0]], np.float32)
    given = scores + np.float32(offset)
    np.testing.assert_allclose(bounded_softmax(given), softmax(scores, axis=1), rtol=1e-5)
    np.testing.assert_array_equal(given, scores + np.float32(offset))
