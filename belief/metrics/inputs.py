"""Validation of the arguments of metrics."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.problem import Floats
from belief.validation import SUM_TOLERANCE, as_real, checked_indices


def checked_probs(probs: ArrayLike) -> Floats:
    """Predicted distributions ``(n, K)`` as float64, renormalised where they sum to one within 2e-3.

    Raises:
        ValueError: empty, not two-dimensional, or a row that is not a distribution; the message names the row.

    >>> float(checked_probs([[0.5, 0.501]]).sum())
    1.0
    """
    p = np.asarray(as_real(probs, "probs"), np.float64)
    if p.ndim != 2 or p.size == 0:
        raise ValueError(f"need probs (n, K) with n ≥ 1 and K ≥ 1, got shape {p.shape}")
    sums = np.where((p >= 0.0) & (p <= 1.0 + SUM_TOLERANCE), p, np.inf) @ np.ones(p.shape[1])
    bad = np.abs(sums - 1.0) > SUM_TOLERANCE
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(
            f"probs in row {row} are no distribution: {p[row].tolist()}; need numbers ≥ 0 with sum 1 ± {SUM_TOLERANCE}"
        )
    return np.asarray(p / sums[:, None])


def checked_pair(probs: ArrayLike, labels: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    """Predicted distributions ``(n, K)``, as from :func:`checked_probs`, and true shapes ``(n,)`` as int64.

    Raises:
        ValueError: as :func:`checked_probs`; another number of labels, or labels that are not integers in [0, K).

    >>> checked_pair([[0.5, 0.5]], [1])[1].tolist()
    [1]
    """
    p, y = np.asarray(as_real(probs, "probs"), np.float64), np.shape(labels)
    if p.ndim != 2 or p.size == 0 or y != (len(p),):
        raise ValueError(f"need probs (n, K) and labels (n,) with n ≥ 1, got {p.shape} and {y}")
    return checked_probs(p), checked_indices("labels", labels, p.shape[1])


def top_label(probs: Floats, labels: NDArray[np.int64]) -> tuple[Floats, NDArray[np.bool_]]:
    """Confidence in the most probable shape, the first of equal ones, and whether it is correct, both ``(n,)``.

    >>> confidence, correct = top_label(np.array([[0.2, 0.8]]), np.array([1]))
    >>> confidence.tolist(), correct.tolist()
    ([0.8], [True])
    """
    top = probs.argmax(axis=1)
    return probs[np.arange(len(probs)), top], top == labels
