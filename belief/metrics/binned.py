"""Binned calibration errors: the gap between mean confidence and share right, in bins of similar confidence.

With the gap of a bin ``gap_b = mean confidence - share right`` and its share of the rows ``w_b = n_b / n``

    ECE = Σ_b w_b |gap_b|                                                      (Naeini et al. 2015, Guo et al. 2017)

of the top shape; classwise, the mean over the shapes k of the same with p_k against "it is k" (Kull et al. 2019). The
debiased error takes off what chance adds to the square of each gap (Kumar et al. 2019).
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.metrics.inputs import checked_pair, top_label
from belief.problem import Floats

Binning: TypeAlias = Literal["width", "mass"]
_MOST_BINS = 1_000_000


def expected_calibration_error(
    probs: ArrayLike, labels: ArrayLike, num_bins: int = 15, binning: Binning = "width"
) -> float:
    """Mean gap between confidence and accuracy of the top shape over confidence bins (lo, hi]; in [0, 1].

    Empty bins count nothing. Positive even for a perfectly calibrated model, by chance (Kumar et al. 2019).

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        num_bins: bins over [0, 1].
        binning: bins of equal ``width``, or of equal ``mass`` (as many rows in each, equal confidences together).

    Raises:
        ValueError: rows that are no distributions, labels out of range, nothing at all, an unknown binning, fewer than
            one or more than a million bins.

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

    Sees what the top shape hides: probabilities of the other shapes, which a search for one target lives on. It is
    small where K is large, as most p_k are near zero.

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        num_bins: bins over [0, 1], of every shape.
        binning: as for :func:`expected_calibration_error`, for every shape by itself.

    Raises:
        ValueError: as :func:`expected_calibration_error`.

    >>> round(classwise_calibration_error([[0.9, 0.1], [0.9, 0.1]], [0, 1]), 3)
    0.4
    """
    p, y = checked_pair(probs, labels)
    gaps = p.copy()
    gaps[np.arange(len(y)), y] -= 1.0
    cells = bin_index(p, num_bins, binning) + num_bins * np.arange(p.shape[1])  # bins of their own for every shape
    return float(np.abs(np.bincount(cells.ravel(), gaps.ravel())).sum() / p.size)


def debiased_calibration_error(
    probs: ArrayLike, labels: ArrayLike, num_bins: int = 15, binning: Binning = "mass"
) -> float:
    """Root mean square gap of the top shape with the part due to chance taken off; in (-1, 1].

    Chance adds to the square of a bin's mean gap the variance of that mean, which the variance s_b² of the gaps within
    the bin (with divisor n_b - 1) estimates without bias:

        E² = Σ_b (n_b / n) (gap_b² - s_b² / n_b),        returned: √E², or -√-E² where E² is negative.

    Where all confidences of a bin are equal this is the debiased estimator of Kumar et al. (2019), for which
    s_b² / n_b = ȳ_b (1 - ȳ_b) / (n_b - 1). A *negative* value says that the model errs less than chance alone would
    have it; it is not cut off at zero, so that E² of a calibrated model averages zero. A bin of one row counts nothing,
    as its noise is unknown.

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        num_bins: bins over [0, 1].
        binning: as for :func:`expected_calibration_error`; equal ``mass`` avoids bins of one row.

    Raises:
        ValueError: as :func:`expected_calibration_error`.

    >>> round(debiased_calibration_error([[0.9, 0.1]] * 4, [0, 0, 1, 1]), 3)  # √(0.16 - 0.25/3)
    0.277
    """
    p, y = checked_pair(probs, labels)
    confidence, correct = top_label(p, y)
    index = bin_index(confidence, num_bins, binning)
    counts = np.bincount(index)
    sizes = np.maximum(counts, 1)
    means = np.bincount(index, confidence - correct) / sizes
    scatter = np.bincount(index, np.square(confidence - correct - means[index]))  # Σ (gap - mean gap)²
    squares = counts * np.square(means) - scatter / np.maximum(counts - 1, 1)
    square = float(squares[counts > 1].sum() / len(y))
    return float(np.copysign(np.sqrt(abs(square)), square))


def bin_index(values: Floats, num_bins: int, binning: Binning) -> NDArray[np.int64]:
    """The bin in [0, num_bins) that each value lies in; bins are open below and closed above, but for the first.

    Args:
        values: in [0, 1], ``(n,)`` or ``(n, J)``, whose columns are binned by themselves.
        num_bins: bins over [0, 1].
        binning: of equal ``width``, or between quantiles of the values (``mass``).

    Returns:
        Of the shape of the values.

    Raises:
        ValueError: an unknown binning; fewer than one or more than a million bins.

    >>> bin_index(np.array([0.0, 0.5, 0.51, 1.0]), 2, "width").tolist()
    [0, 0, 1, 1]
    """
    if binning == "mass" and values.ndim == 2:
        return np.stack([bin_index(column, num_bins, binning) for column in values.T], axis=1)
    edges = bin_edges(values, num_bins, binning)
    if binning == "mass":
        return np.maximum(np.searchsorted(edges, values) - 1, 0)
    index = np.minimum((values * num_bins).astype(np.int64), num_bins - 1)  # five times as fast as a search
    index -= values <= edges[index]  # on an edge, or rounded over one
    index += values > edges[index + 1]
    return np.maximum(index, 0)


def bin_edges(values: Floats, num_bins: int, binning: Binning) -> Floats:
    """Where the bins of :func:`bin_index` begin and end, ``(num_bins + 1,)``, non-decreasing.

    >>> bin_edges(np.array([0.3, 0.4, 0.9]), 2, "mass").tolist()
    [0.3, 0.4, 0.9]
    """
    if not isinstance(num_bins, int | np.integer) or not 1 <= num_bins <= _MOST_BINS:
        raise ValueError(f"num_bins must be an integer from 1 to {_MOST_BINS}, got {num_bins}")
    fractions = np.arange(num_bins + 1) / num_bins
    if binning == "width":
        return fractions
    if binning == "mass":
        return np.quantile(values, fractions)
    raise ValueError(f"binning must be 'width' or 'mass', got {binning!r}")
