r"""Proper scores, scores of each shape, and calibration errors: gaps between confidence and accuracy.

With the gap of a bin ``gap_b = mean confidence - accuracy`` and its fraction of the rows ``w_b = n_b / n``,

    ECE = Σ_b w_b |gap_b|                                                      (Naeini et al. 2015, Guo et al. 2017)

for the top shape. The classwise error is the mean over shapes k of the same for p_k and the event "the label is k"
(Kull et al. 2019). The smooth error smECE of Błasiok and Nakkiran (2023, arXiv 2309.12236) has no bins: the gaps
(confidence - correct) are smoothed over the confidence axis by a Gaussian kernel of width σ, reflected at both ends,
and smECE is the unique σ with smECE_σ = σ,

    r_σ(t) = mean over rows of  K_σ(t, confidence) · (confidence - correct),        smECE_σ = ∫₀¹ |r_σ(t)| dt.

Reflected smoothing multiplies the coefficient of cos(πkt) by exp(-π²k²σ²/2). The gaps are therefore interpolated onto a
fine grid, and one cosine transform is used for all widths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dct
from scipy.optimize import brentq

from belief.validation import Floats, checked_pair, checked_values, require_count

_CELLS_PER_WIDTH = 32
_CELLS = (2**11, 2**13, 2**15, 2**17)  # coarsest first; large errors need no finer grid


def smooth_calibration_error(probs: ArrayLike, labels: ArrayLike) -> float:
    """Smooth calibration error of the top shape of ``probs (n, K)`` for ``labels (n,)``, in [0, 1].

    It is positive by chance for a calibrated model. The relative error is 1e-4 for results down to 2.4e-4; smaller
    results have an absolute error below 2.4e-4. Errors are those of :func:`~belief.validation.checked_pair`.

    >>> round(smooth_calibration_error([[0.9, 0.1], [0.9, 0.1]], [0, 1]), 3)     # equal gaps
    0.4
    """
    p, y = checked_pair(probs, labels)
    confidence, correct = top_label(p, y)
    gaps = (confidence - correct) / len(y)
    widest = 2.0  # above any error
    for num_cells in _CELLS:
        transform, least = _transform(confidence, gaps, num_cells), _CELLS_PER_WIDTH / num_cells
        error = _smoothed(least, transform)
        if error >= least:
            return min(
                1.0, float(brentq(lambda width, t: _smoothed(width, t) - width, least, widest, args=(transform,)))
            )
        widest = 2.0 * least  # the root is below `least`, up to the error of this grid
    return error


def _transform(confidence: Floats, gaps: Floats, num_cells: int) -> Floats:
    """Coefficients Σ gap · cos(πk confidence) for k = 0 … num_cells, of gaps put on the grid."""
    cell = np.minimum((confidence * num_cells).astype(np.int64), num_cells - 1)
    upper = gaps * (confidence * num_cells - cell)
    grid = np.bincount(cell, gaps - upper, num_cells + 1) + np.bincount(cell + 1, upper, num_cells + 1)
    counted = np.concatenate([grid[:1], grid[1:-1] / 2.0, grid[-1:]])  # dct counts inner points twice
    return np.asarray(dct(counted, type=1))


def _smoothed(width: float, transform: Floats) -> float:
    """∫₀¹ |r_σ(t)| dt by the trapezoid rule, on as many points as there are coefficients."""
    damping = np.exp(-0.5 * np.square(np.pi * width * np.arange(len(transform))))
    heights = np.abs(dct(transform * damping, type=1))
    return float((heights.sum() - (heights[0] + heights[-1]) / 2.0) / (len(heights) - 1))


Binning: TypeAlias = Literal["width", "mass"]
_MOST_BINS = 1_000_000


def expected_calibration_error(
    probs: ArrayLike, labels: ArrayLike, num_bins: int = 15, binning: Binning = "width"
) -> float:
    """Mean gap between confidence and accuracy of the top shape over confidence bins (lo, hi]; in [0, 1].

    It is positive by chance even for a perfectly calibrated model (Kumar et al. 2019).

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        num_bins: bins over [0, 1].
        binning: bins of equal ``width``, or of equal ``mass``: the same number of rows in each, up to ties.

    Raises:
        ValueError: as :func:`~belief.validation.checked_pair` and :func:`bin_edges`.

    >>> round(expected_calibration_error([[0.9, 0.1], [0.9, 0.1]], [0, 1]), 3)
    0.4
    """
    p, y = checked_pair(probs, labels)
    confidence, correct = top_label(p, y)
    gaps = np.bincount(bin_index(confidence, num_bins, binning), confidence - correct)
    return float(np.abs(gaps).sum() / len(y))


def classwise_calibration_error(
    probs: ArrayLike, labels: ArrayLike, num_bins: int = 15, binning: Binning = "width"
) -> float:
    """Mean over the shapes k of the calibration error of p_k as the probability that it is k; in [0, 1].

    Unlike the error of the top shape it includes the probabilities of all shapes, which a search for one target uses.
    It is small for large K, because most p_k are near zero. Arguments and errors are those of
    :func:`expected_calibration_error`; each shape has separate bins.

    >>> round(classwise_calibration_error([[0.9, 0.1], [0.9, 0.1]], [0, 1]), 3)
    0.4
    """
    p, y = checked_pair(probs, labels)
    gaps = p.copy()
    gaps[np.arange(len(y)), y] -= 1.0
    cells = bin_index(p, num_bins, binning) + num_bins * np.arange(p.shape[1])  # separate bins for each shape
    return float(np.abs(np.bincount(cells.ravel(), gaps.ravel())).sum() / p.size)


def bin_index(values: Floats, num_bins: int, binning: Binning) -> NDArray[np.int64]:
    """Index in [0, num_bins) of the bin (lo, hi] of each value; the first bin also includes its lower edge.

    Args:
        values: in [0, 1], ``(n,)``, or ``(n, J)`` with separate bins for each column.
        num_bins: bins over [0, 1].
        binning: ``width`` for equal width, ``mass`` for quantiles of the values.

    Raises:
        ValueError: as :func:`bin_edges`.
    """
    if binning == "mass" and values.ndim == 2:
        return np.stack([bin_index(column, num_bins, binning) for column in values.T], axis=1)
    edges = bin_edges(values, num_bins, binning)
    if binning == "mass":
        return np.maximum(np.searchsorted(edges, values) - 1, 0)
    index = np.minimum((values * num_bins).astype(np.int64), num_bins - 1)  # five times as fast as a search
    index -= values <= edges[index]  # on an edge, or across one by rounding
    index += values > edges[index + 1]
    return np.maximum(index, 0)


def bin_edges(values: Floats, num_bins: int, binning: Binning) -> Floats:
    """Edges of the bins of :func:`bin_index`, ``(num_bins + 1,)``, non-decreasing."""
    require_count("num_bins", num_bins, most=_MOST_BINS)
    if binning == "width":
        return np.arange(num_bins + 1) / num_bins
    if binning == "mass":  # in integers: np.quantile rounds the ranks, and may put a value into the next bin
        below, more = np.divmod(np.arange(num_bins + 1) * (len(values) - 1), num_bins)
        x = np.sort(values)
        return np.asarray(x[below] + (x[np.minimum(below + 1, len(x) - 1)] - x[below]) * (more / num_bins))
    raise ValueError(f"binning must be 'width' or 'mass', got {binning!r}")


def top_label(probs: Floats, labels: NDArray[np.int64]) -> tuple[Floats, NDArray[np.bool_]]:
    """Confidence in the most probable shape, the first of equal ones, and whether it is correct, both ``(n,)``."""
    top = probs.argmax(axis=1)
    return probs[np.arange(len(probs)), top], top == labels


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
