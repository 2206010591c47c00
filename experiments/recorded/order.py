"""The best fixed order of actions, ranked on calibration touches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from belief.observation_model.action_kernel import touch_weights
from belief.observation_model.calibration_data import LabelledTouches
from belief.validation import Floats
from planners.pose_order import greedy_order


def best_order(data: LabelledTouches, sessions: NDArray[np.int64], kernel: Floats, threshold: float) -> tuple[int, ...]:
    """The better of two greedy orders: by the negative log posterior, and by the share of certain objects.

    Better is which needs fewer touches on the calibration data until a label has the probability ``threshold``.

    Args:
        data: calibration touches.
        sessions: of each, ``(n,)``.
        kernel: correlations between actions, ``(P, P)``.
        threshold: probability at which searches stop.
    """
    ratios, labels = by_session(data, sessions)
    if len(ratios) == 0 or data.num_poses == 1:
        return tuple(range(data.num_poses))

    def loss(actions: tuple[int, ...]) -> float:
        return -float(fused(ratios, kernel, actions)[np.arange(len(labels)), labels].mean())

    def uncertain(actions: tuple[int, ...]) -> float:
        certain = fused(ratios, kernel, actions).max(axis=1) >= np.log(threshold)
        return -float(certain.mean()) + 1e-3 * loss(actions)

    size = data.num_poses
    orders = [greedy_order(size, size, score)[0] for score in (loss, uncertain)]
    return min(orders, key=lambda order: _mean_touches(ratios, kernel, order, threshold))


def by_session(data: LabelledTouches, sessions: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """Ratios of the sessions that have a touch with every action, ``(G, P, K)``, and the labels, ``(G,)``."""
    _, group = np.unique(np.stack([data.objects, sessions]), axis=1, return_inverse=True)
    table = np.full((int(group.max()) + 1, data.num_poses, data.num_shapes), np.nan)
    labels = np.zeros(len(table), np.int64)
    table[group.ravel(), data.poses] = data.logits
    labels[group.ravel()] = data.shapes
    whole = ~np.isnan(table).any(axis=(1, 2))
    return table[whole], labels[whole]


def fused(ratios: Floats, kernel: Floats, actions: tuple[int, ...]) -> Floats:
    """Log posteriors ``(G, K)`` after one touch with each of some actions."""
    counts = np.bincount(actions, minlength=len(kernel))
    weights = touch_weights(counts, kernel) * counts
    return np.asarray(log_softmax(np.einsum("p,gpk->gk", weights, ratios), axis=1))


def _mean_touches(ratios: Floats, kernel: Floats, order: tuple[int, ...], threshold: float) -> float:
    waiting, total = np.ones(len(ratios), np.bool_), 0.0
    for step in range(len(order)):
        total += waiting.mean()
        waiting &= fused(ratios, kernel, order[: step + 1]).max(axis=1) < np.log(threshold)
    return total
