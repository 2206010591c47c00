"""Laws of the evidence from several touches of one body."""

import numpy as np
import pytest
from scipy.special import logsumexp

from benchmarks.bayes_error.evidence import Evidence, joint_log_likelihoods, log_posterior


def logs_and_orders(rng, objects=5, poses=6, shapes=3, bodies=20, spread=3.0):
    logs = spread * rng.normal(size=(objects, poses, shapes, bodies))
    return logs, np.stack([rng.permutation(poses) for _ in range(objects)])


def test_one_touch_says_the_same_jointly_and_independently(rng):
    logs, orders = logs_and_orders(rng)
    evidence = joint_log_likelihoods(logs, orders)
    np.testing.assert_allclose(evidence.joint[:, 0], evidence.independent(orders)[:, 0])


def test_it_is_the_mean_over_bodies_of_the_product_over_touches(rng):
    logs, orders = logs_and_orders(rng)
    evidence = joint_log_likelihoods(logs, orders)
    for n, order in enumerate(orders):
        likelihoods = np.exp(logs[n, order])  # (T, K, N), in order
        np.testing.assert_allclose(np.exp(evidence.joint[n]), np.cumprod(likelihoods, axis=0).mean(axis=2))
        np.testing.assert_allclose(
            np.exp(evidence.independent(orders)[n]), np.cumprod(likelihoods.mean(axis=2), axis=0)
        )


def test_the_order_of_touches_does_not_matter_in_the_end(rng):
    logs, orders = logs_and_orders(rng)
    first, second = (joint_log_likelihoods(logs, some) for some in (orders, orders[:, ::-1]))
    np.testing.assert_allclose(first.joint[:, -1], second.joint[:, -1])
    np.testing.assert_allclose(first.independent(orders)[:, -1], second.independent(orders[:, ::-1])[:, -1])


def test_bodies_that_are_all_alike_make_touches_independent(rng):
    logs, orders = logs_and_orders(rng, bodies=1)
    evidence = joint_log_likelihoods(np.repeat(logs, 7, axis=3), orders)
    np.testing.assert_allclose(evidence.joint, evidence.independent(orders))


def test_a_body_without_spread_is_recognised_exactly():
    # Each of two shapes has two bodies, and each touch is one of two bits. Single touches say nothing; two touches
    # agree for the bodies of one shape and differ for those of the other.
    certain, never = 0.0, -np.inf
    bits = np.array([[[0, 1], [0, 1]], [[0, 1], [1, 0]]])  # of pose, shape, body
    for shape in range(2):
        seen = bits[:, shape, 0]
        logs = np.where(bits == seen[:, None, None], certain, never)[None]
        evidence = joint_log_likelihoods(logs, np.array([[1, 0]]))
        posterior = np.exp(log_posterior(evidence.joint))
        np.testing.assert_allclose(posterior, [[[0.5, 0.5], np.eye(2)[shape]]])
        np.testing.assert_allclose(np.exp(log_posterior(evidence.independent(np.array([[1, 0]])))), 0.5)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3, 1e6])
def test_extreme_logs_neither_overflow_nor_vanish(rng, scale):
    logs, orders = logs_and_orders(rng, spread=scale)
    evidence = joint_log_likelihoods(logs, orders)
    expected = logsumexp(logs.sum(axis=1), axis=2) - np.log(logs.shape[3])
    np.testing.assert_allclose(evidence.joint[:, -1], expected, rtol=1e-9)
    assert np.isfinite(log_posterior(evidence.joint)).all()
    shifted = joint_log_likelihoods(logs - 1e5, orders)
    np.testing.assert_allclose(log_posterior(shifted.joint), log_posterior(evidence.joint), atol=1e-6)


def test_a_shape_that_no_body_explains_has_no_evidence():
    logs = np.zeros((1, 2, 2, 3))
    logs[:, :, 1] = -np.inf
    evidence = joint_log_likelihoods(logs, np.array([[0, 1]]))
    np.testing.assert_array_equal(np.exp(log_posterior(evidence.joint)), [[[1.0, 0.0]] * 2])


def test_parts_of_a_bank_pool_to_the_whole(rng):
    logs, orders = logs_and_orders(rng, bodies=20)
    whole = joint_log_likelihoods(logs, orders)
    pooled = Evidence.pooled([joint_log_likelihoods(part, orders) for part in np.split(logs, 4, axis=3)])
    by_shape = Evidence.of_shapes([joint_log_likelihoods(logs[:, :, [k]], orders) for k in range(3)])
    for found in (pooled, by_shape):
        np.testing.assert_allclose(found.joint, whole.joint)
        np.testing.assert_allclose(found.single, whole.single)
