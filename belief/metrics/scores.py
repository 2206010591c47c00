"""Accuracy, the logarithmic score, the Brier score, and scores of each shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.validation import checked_pair, checked_values


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


def confusion_matrix(probs: ArrayLike, labels: ArrayLike) -> NDArray[np.int64]:
    """Counts of (true shape, predicted shape), ``(K, K)``.

    >>> confusion_matrix([[0.9, 0.1], [0.2, 0.8], [0.7, 0.3]], [0, 1, 1]).tolist()
    [[1, 0], [1, 1]]
    """
    p, y = checked_pair(probs, labels)
    matrix = np.zeros((p.shape[1], p.shape[1]), np.int64)
    np.add.at(matrix, (y, p.argmax(axis=1)), 1)
    return matrix


@dataclass(frozen=True)
class ShapeScore:
    """Precision, recall and F1 of one shape; a ratio without cases is 0.

    Attributes:
        precision: fraction of its predictions that are correct.
        recall: fraction of its rows that are predicted correctly.
        f1: harmonic mean of the two.
        support: number of its rows.

    >>> ShapeScore(precision=0.5, recall=1.0, f1=2 / 3, support=3).support
    3
    """

    precision: float
    recall: float
    f1: float
    support: int


def shape_scores(confusion: ArrayLike) -> list[ShapeScore]:
    """Precision, recall and F1 of every shape, from counts of (true shape, predicted shape), ``(K, K)``.

    Raises:
        ValueError: counts that are no numbers, not square, negative, or not finite and at most 1e150.

    >>> [round(score.f1, 3) for score in shape_scores([[8, 2], [0, 10]])]
    [0.889, 0.909]
    """
    counts = checked_values("counts", confusion)  # as float64: sums of narrow types overflow
    if counts.ndim != 2 or counts.shape[0] != counts.shape[1] or counts.size == 0:
        raise ValueError(f"need counts (K, K) with K ≥ 1, got {counts.shape}")
    if (counts < 0.0).any():
        raise ValueError(f"counts must be ≥ 0, got {counts.tolist()}")
    right, predicted, true = np.diag(counts), counts.sum(axis=0), counts.sum(axis=1)
    scores = []
    for k in range(len(counts)):
        precision = right[k] / predicted[k] if predicted[k] else 0.0
        recall = right[k] / true[k] if true[k] else 0.0
        f1 = 2 * right[k] / (predicted[k] + true[k]) if predicted[k] + true[k] else 0.0
        scores.append(ShapeScore(float(precision), float(recall), float(f1), int(true[k])))
    return scores
