"""The expected information of a touch about the body, where there are many bodies in many orientations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from belief.coarse_to_fine import CoarseToFine, Leaves
from belief.validation import Floats


def body_information(log_ratios: NDArray[np.floating], weights: Floats, bodies: NDArray[np.integer]) -> Floats:
    """Expected information of a touch in each pose about the body [nats], ``(P,)``.

    ``log_ratios (P, n, M)``, log p(touch | hypothesis) / p(touch) of M equally probable reference touches, are
    overwritten; ``weights (n,)`` are the posterior of the hypotheses, and ``bodies (n,)`` are their bodies.

    >>> tells, silent = np.log([[0.9, 0.1], [0.1, 0.9]]), np.zeros((2, 2))
    >>> body_information(np.stack([tells, silent]), np.full(2, 0.5), np.array([3, 7])).round(3).tolist()
    [0.368, 0.0]
    """
    log_ratios -= log_ratios.max(axis=2, keepdims=True)
    probs = np.exp(log_ratios, out=log_ratios)
    probs *= (weights / weights.sum()).astype(probs.dtype)[:, None] / probs.sum(axis=2, keepdims=True)
    order = np.argsort(bodies, kind="stable")
    starts = np.flatnonzero(np.diff(bodies[order], prepend=bodies[order[0]] - 1))
    joint = np.add.reduceat(probs[:, order], starts, axis=1)  # of body and touch, (P, B, M)
    return _entropies(joint.sum(axis=1)) + _entropies(joint.sum(axis=2)) - _entropies(joint.reshape(len(joint), -1))


def sampled_leaves(belief: CoarseToFine, number: int) -> tuple[Leaves, Floats]:
    """At most ``number`` cells that stand for a posterior, by systematic resampling, and their weights."""
    leaves = belief.leaves()
    above = np.cumsum(np.exp(leaves.log_weight - leaves.log_weight.max()))
    drawn = np.searchsorted(above, (np.arange(number) + 0.5) / number * above[-1])
    rows, counts = np.unique(np.minimum(drawn, len(above) - 1), return_counts=True)
    return Leaves(*(part[rows] for part in leaves)), counts / number


def _entropies(probs: NDArray[np.floating]) -> Floats:
    """Entropy of each row of probabilities."""
    return -np.where(probs > 0.0, probs * np.log(np.maximum(probs, np.finfo(probs.dtype).tiny)), 0.0).sum(
        axis=-1, dtype=float
    )
