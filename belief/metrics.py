"""How good probabilities are: proper scores and calibration errors, for ``probs (n, K)`` and ``labels (n,)``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.problem import Floats


def accuracy(probs: ArrayLike, labels: ArrayLike) -> float:
    """Share of rows whose most probable shape is the true one, in [0, 1]."""
    p, y = _check(probs, labels)
    return float(np.mean(p.argmax(axis=1) == y))


def negative_log_likelihood(probs: ArrayLike, labels: ArrayLike) -> float:
    """Mean of -log p(label) [nats]; infinite if some label had probability zero.

    >>> round(negative_log_likelihood([[0.5, 0.5], [0.9, 0.1]], [0, 0]), 4)
    0.3993
    """
    p, y = _check(probs, labels)
    with np.errstate(divide="ignore"):
        return float(-np.mean(np.log(p[np.arange(len(y)), y])))


def brier_score(probs: ArrayLike, labels: ArrayLike) -> float:
    """Mean over rows of the squared distance to the one-hot label, summed over shapes; in [0, 2].

    >>> round(brier_score([[0.5, 0.5], [0.9, 0.1]], [0, 0]), 4)
    0.26
    """
    p, y = _check(probs, labels)
    return float(np.mean(((p - np.eye(p.shape[1])[y]) ** 2).sum(axis=1)))


def expected_calibration_error(
    probs: ArrayLike,
    labels: ArrayLike,
    num_bins: int = 15,
    binning: Literal["width", "mass"] = "width",
) -> float:
    """Mean gap between confidence and accuracy of the top shape over confidence bins (lo, hi]; in [0, 1].

    Empty bins count nothing. Positive even for a perfectly calibrated model, by chance (Kumar et al. 2019).

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        num_bins: bins over [0, 1].
        binning: bins of equal ``width``, or of equal ``mass`` (as many rows in each).

    >>> round(expected_calibration_error([[0.9, 0.1], [0.9, 0.1]], [0, 1]), 3)
    0.4
    """
    p, y = _check(probs, labels)
    if num_bins < 1:
        raise ValueError(f"num_bins must be at least 1, got {num_bins}")
    confidence, correct = p.max(axis=1), p.argmax(axis=1) == y
    if binning == "width":
        edges = np.linspace(0.0, 1.0, num_bins + 1)
    elif binning == "mass":
        edges = np.quantile(confidence, np.linspace(0.0, 1.0, num_bins + 1))
    else:
        raise ValueError(f"binning must be 'width' or 'mass', got {binning!r}")
    bin_index = np.clip(np.searchsorted(edges, confidence) - 1, 0, num_bins - 1)
    gaps = np.bincount(bin_index, confidence - correct, minlength=num_bins)
    return float(np.abs(gaps).sum() / len(y))


def confusion_matrix(probs: ArrayLike, labels: ArrayLike) -> NDArray[np.int64]:
    """Counts of (true shape, predicted shape), ``(K, K)``."""
    p, y = _check(probs, labels)
    matrix = np.zeros((p.shape[1], p.shape[1]), np.int64)
    np.add.at(matrix, (y, p.argmax(axis=1)), 1)
    return matrix


@dataclass(frozen=True)
class ShapeScore:
    """How well one shape is recognised; a ratio without cases is 0.

    Attributes:
        precision: share of what was taken for it that was it.
        recall: share of it that was recognised.
        f1: harmonic mean of the two.
        support: how many there were.
    """

    precision: float
    recall: float
    f1: float
    support: int


def shape_scores(confusion: ArrayLike) -> list[ShapeScore]:
    """Precision, recall and F1 of every shape, from counts of (true shape, predicted shape).

    >>> [round(score.f1, 3) for score in shape_scores([[8, 2], [0, 10]])]
    [0.889, 0.909]
    """
    counts = np.asarray(confusion)
    if counts.ndim != 2 or counts.shape[0] != counts.shape[1] or counts.size == 0:
        raise ValueError(f"need counts (K, K) with K ≥ 1, got {counts.shape}")
    if not (np.isfinite(counts).all() and (counts >= 0).all()):
        raise ValueError(f"counts must be finite and ≥ 0, got {counts.tolist()}")
    right, taken, there = np.diag(counts), counts.sum(axis=0), counts.sum(axis=1)
    scores = []
    for k in range(len(counts)):
        precision = right[k] / taken[k] if taken[k] else 0.0
        recall = right[k] / there[k] if there[k] else 0.0
        f1 = 2 * right[k] / (taken[k] + there[k]) if taken[k] + there[k] else 0.0
        scores.append(ShapeScore(float(precision), float(recall), float(f1), int(there[k])))
    return scores


def _check(probs: ArrayLike, labels: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    p, y = np.asarray(probs, np.float64), np.asarray(labels)
    if p.ndim != 2 or p.size == 0 or y.shape != (len(p),):
        raise ValueError(f"need probs (n, K) and labels (n,) with n ≥ 1, got {p.shape} and {y.shape}")
    bad = ~((p >= 0.0).all(axis=1) & (np.abs(p.sum(axis=1) - 1.0) <= 2e-3))
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(f"probs in row {row} are no distribution: {p[row].tolist()}")
    if not np.issubdtype(y.dtype, np.integer) or y.min() < 0 or y.max() >= p.shape[1]:
        raise ValueError(f"labels must be integers in [0, {p.shape[1]}), got {y.dtype} from {y.min()} to {y.max()}")
    return p / p.sum(axis=1, keepdims=True), y.astype(np.int64)
