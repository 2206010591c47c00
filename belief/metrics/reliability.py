"""The reliability curve: accuracy by confidence, with consistency bands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.frozen import FrozenArrays
from belief.metrics.binned import Binning, bin_edges, bin_index, top_label
from belief.validation import Floats, checked_pair, require_fraction


@dataclass(frozen=True, eq=False)
class ReliabilityCurve(FrozenArrays):
    """One entry for each bin that is not empty, in ascending order, all ``(B,)`` with 1 ≤ B ≤ ``num_bins``.

    Attributes:
        lower, upper: edges of the bin (lower, upper].
        count: rows in the bin, ≥ 1.
        mean_confidence: of these rows.
        accuracy: fraction of these rows that are correct.
        band_low, band_high: the accuracy of a calibrated model lies between them with at least the given probability.

    >>> curve = reliability_curve([[0.9, 0.1], [0.9, 0.1]], [0, 1])
    >>> curve.accuracy.tolist(), curve.is_consistent.tolist()
    ([0.5], [True])
    """

    lower: Floats
    upper: Floats
    count: NDArray[np.int64]
    mean_confidence: Floats
    accuracy: Floats
    band_low: Floats
    band_high: Floats

    @property
    def is_consistent(self) -> NDArray[np.bool_]:
        """Whether the accuracy lies within its band, ``(B,)``."""
        return (self.band_low <= self.accuracy) & (self.accuracy <= self.band_high)

    def plot(self, axes: Any) -> None:
        """Draw the curve on a matplotlib axis: points, whose area shows the rows, and the bands in grey.

        The points of a calibrated model lie in their bands with the given probability, if rows are independent.
        """
        axes.plot([0, 1], [0, 1], color=axes.xaxis.label.get_color(), linewidth=0.8, linestyle=":")
        width = 0.8 * (self.upper - self.lower)
        band = {"color": "#8a97a5", "alpha": 0.3, "linewidth": 0}
        axes.bar(self.mean_confidence, self.band_high - self.band_low, width, self.band_low, **band)
        size = 8.0 + 120.0 * self.count / self.count.sum()
        axes.scatter(self.mean_confidence, self.accuracy, size, color="C0", zorder=3)
        low = max(0.0, float(self.lower.min()) - 0.05)
        axes.set(xlabel="confidence", ylabel="accuracy", xlim=(low, 1.02), ylim=(low, 1.02))


def reliability_curve(
    probs: ArrayLike,
    labels: ArrayLike,
    num_bins: int = 15,
    binning: Binning = "width",
    confidence: float = 0.95,
) -> ReliabilityCurve:
    """Mean confidence against accuracy in bins (lo, hi], with consistency bands (Bröcker and Smith 2007).

    The bands are binomial quantiles at the bin's mean confidence. They are slightly too wide, because the number of
    correct rows has unequal probabilities and therefore less spread than the binomial (Hoeffding 1956).

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        num_bins: bins over [0, 1].
        binning: as for :func:`~belief.metrics.binned.expected_calibration_error`.
        confidence: of each single band, in (0, 1).

    Raises:
        ValueError: as :func:`~belief.validation.checked_pair` and :func:`~belief.metrics.binned.bin_edges`; a
            confidence out of range.

    >>> curve = reliability_curve([[0.8, 0.2]] * 10 + [[0.3, 0.7]] * 10, [0] * 20, num_bins=10)
    >>> curve.mean_confidence.round(2).tolist(), curve.accuracy.tolist(), curve.band_low.round(1).tolist()
    ([0.7, 0.8], [0.0, 1.0], [0.4, 0.5])
    """
    p, y = checked_pair(probs, labels)
    require_fraction("confidence", confidence)
    predicted, happened = top_label(p, y)
    edges, index = bin_edges(predicted, num_bins, binning), bin_index(predicted, num_bins, binning)
    filled, index, count = np.unique(index, return_inverse=True, return_counts=True)
    mean = np.clip(np.bincount(index, predicted) / count, 0.0, 1.0)  # rounding may leave it above one
    from scipy import stats  # which takes a quarter of a second

    tail = (1.0 - confidence) / 2
    return ReliabilityCurve(
        lower=edges[filled],
        upper=edges[filled + 1],
        count=count,
        mean_confidence=mean,
        accuracy=np.bincount(index, happened) / count,
        band_low=stats.binom.ppf(tail, count, mean) / count,
        band_high=stats.binom.isf(tail, count, mean) / count,
    )


def reliability_diagram(probs: ArrayLike, labels: ArrayLike, axes: Any, **options: Any) -> ReliabilityCurve:
    """Draw accuracy against confidence, with the bands of a calibrated model, on a matplotlib axis.

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        axes: matplotlib axis, such as ``matplotlib.pyplot.gca()``.
        options: further arguments of :func:`reliability_curve`, such as ``num_bins``.

    Returns:
        The curve that was drawn.

    Raises:
        ValueError: as :func:`reliability_curve`.

    >>> from matplotlib.figure import Figure
    >>> axes = Figure().subplots()
    >>> reliability_diagram([[0.8, 0.2]] * 10, [0] * 8 + [1] * 2, axes).is_consistent.tolist(), axes.get_xlabel()
    ([True], 'confidence')
    """
    curve = reliability_curve(probs, labels, **options)
    curve.plot(axes)
    return curve
