"""Accuracy, the logarithmic score and the Brier score."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from belief.validation import checked_pair


def accuracy(probs: ArrayLike, labels: ArrayLike) -> float:
    """Fraction of rows of ``probs (n, K)`` whose most probable shape is the label ``(n,)``, in [0, 1].

    >>> accuracy([[0.5, 0.5], [0.9, 0.1]], [0, 1])     # a tie goes to the first
    0.5
    """
    p, y = checked_pair(probs, labels)
    return float(np.mean(p.argmax(axis=1) == y))


def negative_log_likelihood(probs: ArrayLike, labels: ArrayLike) -> float:
    """Mean of -log p(label) [nats] for ``probs (n, K)``, ``labels (n,)``; infinite if a label has probability zero.

    >>> round(negative_log_likelihood([[0.5, 0.5], [0.9, 0.1]], [0, 0]), 4)
    0.3993
    """
    p, y = checked_pair(probs, labels)
    with np.errstate(divide="ignore"):
        return float(np.mean(-np.log(p[np.arange(len(y)), y])) + 0.0)  # not -0.0


def brier_score(probs: ArrayLike, labels: ArrayLike) -> float:
    """Mean squared distance of ``probs (n, K)`` to the one-hot ``labels (n,)``, summed over shapes; in [0, 2].

    >>> round(brier_score([[0.5, 0.5], [0.9, 0.1]], [0, 0]), 4)
    0.26
    """
    p, y = checked_pair(probs, labels)
    gaps = p.copy()
    gaps[np.arange(len(y)), y] -= 1.0
    return float(np.square(gaps).sum() / len(y))
