"""Laws of the evidence from several touches of one body."""

import numpy as np

from benchmarks.bayes_error.evidence import joint_log_likelihoods


def logs_and_orders(rng, objects=5, poses=6, shapes=3, bodies=20, spread=3.0):
    logs = spread * rng.normal(size=(objects, poses, shapes, bodies))
    return logs, np.stack([rng.permutation(poses) for _ in range(objects)])


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
