"""The Brier score and its decomposition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from belief.metrics.binned import Binning, bin_index
from belief.metrics.inputs import checked_pair
from belief.problem import Floats


def brier_score(probs: ArrayLike, labels: ArrayLike) -> float:
    """Mean squared distance of ``probs (n, K)`` to the one-hot ``labels (n,)``, summed over shapes; in [0, 2].

    >>> round(brier_score([[0.5, 0.5], [0.9, 0.1]], [0, 0]), 4)
    0.26
    """
    p, y = checked_pair(probs, labels)
    gaps = p.copy()
    gaps[np.arange(len(y)), y] -= 1.0
    return float(np.square(gaps).sum() / len(y))


@dataclass(frozen=True)
class BrierDecomposition:
    """Terms that add up to the Brier score: of one shape, or summed over all.

    Attributes:
        reliability: mean squared gap between the predicted and the observed frequency of a bin; 0 is best.
        resolution: variance of the observed frequency between bins, at most ``uncertainty``; more is better.
        uncertainty: variance of the labels, independent of the predictions.
        within_bin_variance: variance of the predictions within bins.
        within_bin_covariance: twice the covariance of predictions and labels within bins.
        shapes: the terms of each of the K shapes if this is their sum; else empty.

    >>> BrierDecomposition(0.01, 0.2, 0.25, 0.0, 0.0).score
    0.06
    """

    reliability: float
    resolution: float
    uncertainty: float
    within_bin_variance: float
    within_bin_covariance: float
    shapes: tuple[BrierDecomposition, ...] = ()

    @property
    def score(self) -> float:
        """The Brier score: reliability - resolution + uncertainty + variance - covariance within bins."""
        between = self.reliability - self.resolution + self.uncertainty
        return between + (self.within_bin_variance - self.within_bin_covariance)


def brier_decomposition(
    probs: ArrayLike, labels: ArrayLike, num_bins: int = 15, binning: Binning = "width"
) -> BrierDecomposition:
    """Decomposition of the Brier score into miscalibration and lack of information.

    Murphy's (1973) reliability - resolution + uncertainty of the event "the label is k" for every k, over bins of p_k,
    with the two terms within bins of Stephenson et al. (2008), which make the sum exact. Arguments and errors are those
    of :func:`~belief.metrics.binned.classwise_calibration_error`.

    >>> parts = brier_decomposition([[0.8, 0.2]] * 4 + [[0.4, 0.6]] * 4, [0, 0, 0, 1, 1, 1, 1, 0])
    >>> round(parts.reliability, 4), round(parts.resolution, 4), round(parts.uncertainty, 4), round(parts.score, 4)
    (0.025, 0.125, 0.5, 0.4)
    """
    p, y = checked_pair(probs, labels)
    shapes = tuple(_of_one_shape(p[:, k], (y == k).astype(np.float64), num_bins, binning) for k in range(p.shape[1]))
    return BrierDecomposition(
        reliability=sum(part.reliability for part in shapes),
        resolution=sum(part.resolution for part in shapes),
        uncertainty=sum(part.uncertainty for part in shapes),
        within_bin_variance=sum(part.within_bin_variance for part in shapes),
        within_bin_covariance=sum(part.within_bin_covariance for part in shapes),
        shapes=shapes,
    )


def _of_one_shape(p: Floats, is_shape: Floats, num_bins: int, binning: Binning) -> BrierDecomposition:
    index = bin_index(p, num_bins, binning)
    counts = np.bincount(index)
    sizes, weights = np.maximum(counts, 1), counts / len(p)
    predicted, observed, base = np.bincount(index, p) / sizes, np.bincount(index, is_shape) / sizes, is_shape.mean()
    inside = p - predicted[index]
    return BrierDecomposition(
        reliability=float(weights @ np.square(predicted - observed)),
        resolution=float(weights @ np.square(observed - base)),
        uncertainty=float(base * (1.0 - base)),
        within_bin_variance=float(np.mean(np.square(inside))),
        within_bin_covariance=float(2.0 * np.mean(inside * (is_shape - observed[index]))),
    )
