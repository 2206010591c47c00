"""The reliability curve, and the calibration report: accuracy, proper scores and calibration errors with intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.frozen import FrozenArrays
from belief.metrics.scores import (
    Binning,
    accuracy,
    bin_edges,
    bin_index,
    brier_score,
    classwise_calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
    smooth_calibration_error,
    top_label,
)
from belief.table import Table, Tabular
from belief.validation import MOST_REPEATED, Floats, checked_pair, checked_probs, require_count, require_fraction


@dataclass(frozen=True, eq=False)
class ReliabilityCurve(FrozenArrays):
    """One entry for each bin that is not empty, in ascending order, all ``(B,)`` with 1 ≤ B ≤ ``num_bins``.

    Attributes:
        lower, upper: edges of the bin (lower, upper].
        count: rows in the bin, ≥ 1.
        mean_confidence: mean confidence of these rows.
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
        binning: as for :func:`~belief.metrics.scores.expected_calibration_error`.
        confidence: confidence level of each single band, in (0, 1).

    Raises:
        ValueError: as :func:`~belief.validation.checked_pair` and :func:`~belief.metrics.scores.bin_edges`; a
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


Metric: TypeAlias = Callable[[Floats, NDArray[np.int64]], float]
_BLOCK = 2_000_000  # labels held in memory at a time


def null_quantile(
    probs: ArrayLike, metric: Metric, rng: np.random.Generator, quantile: float = 0.95, num_resamples: int = 1000
) -> float:
    """Quantile of a metric for a perfectly calibrated model with these predictions.

    Labels are drawn from the predicted probabilities. A model whose calibration error is below the 95 % quantile cannot
    be distinguished from a calibrated one.

    Args:
        probs: ``(n, K)``.
        metric: a function of ``(probs (n, K), labels (n,))``, such as ``expected_calibration_error``.
        rng: draws the labels.
        quantile: in (0, 1).
        num_resamples: number of sets of n labels.

    Raises:
        ValueError: as :func:`~belief.validation.checked_probs`; a quantile outside (0, 1), or a metric that returns
            NaN or infinity.

    >>> from belief.metrics import expected_calibration_error
    >>> sure, unsure = np.array([[1.0, 0.0]] * 100), np.array([[0.5, 0.5]] * 100)
    >>> null_quantile(sure, expected_calibration_error, np.random.default_rng(0))
    0.0
    >>> round(null_quantile(unsure, expected_calibration_error, np.random.default_rng(0)), 2)    # 1.96 · 0.5 / √100
    0.1
    """
    p = checked_probs(probs)
    require_fraction("quantile", quantile)
    scores = [float(metric(p, labels)) for block in drawn_labels(p, rng, num_resamples) for labels in block]
    if not np.isfinite(scores).all():
        raise ValueError(f"the metric must return finite numbers, got {scores[int(np.argmin(np.isfinite(scores)))]}")
    return float(np.quantile(scores, quantile))


def drawn_labels(probs: Floats, rng: np.random.Generator, num_resamples: int) -> Iterator[NDArray[np.int64]]:
    """Sets of labels drawn from checked ``probs (n, K)``, in blocks ``(number of sets, n)`` that fit in memory."""
    require_count("num_resamples", num_resamples, most=MOST_REPEATED)
    cumulative = probs.cumsum(axis=1)
    cumulative /= cumulative[:, -1:]  # exactly one at the end
    size = max(1, _BLOCK // len(probs))
    for done in range(0, num_resamples, size):
        uniform = rng.random((min(size, num_resamples - done), len(probs)))
        labels = np.zeros(uniform.shape, np.int64)
        for bound in cumulative[:, :-1].T:
            labels += uniform >= bound
        yield labels


@dataclass(frozen=True)
class CalibrationError:
    """A calibration error with its null quantile.

    Attributes:
        value: calibration error of the model.
        null_quantile: 95 % quantile for a perfectly calibrated model with these predictions.
    """

    value: float
    null_quantile: float

    @property
    def exceeds_chance(self) -> bool:
        """Whether the value exceeds the null quantile."""
        return self.value > self.null_quantile


@dataclass(frozen=True, eq=False)
class CalibrationReport(Tabular):
    """Scores and calibration errors of a model's probabilities; prints as a table.

    Attributes:
        num_rows: n.
        accuracy: fraction of rows whose top shape is correct.
        negative_log_likelihood: [nats]; infinite if a true shape had probability zero.
        brier: the Brier score.
        ece_width: expected calibration error of the top shape, bins of equal width.
        ece_mass: the same, bins of equal mass.
        ece_classwise: classwise calibration error.
        smooth: smECE.
        curve: reliability curve of the top shape.

    >>> probs, labels = np.repeat([[0.9, 0.1]], 50, axis=0), np.arange(50) % 2       # right in half, states 0.9
    >>> calibration_report(probs, labels).ece_width.exceeds_chance
    True
    """

    num_rows: int
    accuracy: float
    negative_log_likelihood: float
    brier: float
    ece_width: CalibrationError
    ece_mass: CalibrationError
    ece_classwise: CalibrationError
    smooth: CalibrationError
    curve: ReliabilityCurve

    def table(self) -> Table:
        """The calibration errors, under the scores."""
        errors: dict[str, CalibrationError] = {title: getattr(self, name) for name, title in _TITLES.items()}
        return Table(
            f"{self.num_rows} rows, accuracy {self.accuracy:.4f}, NLL {self.negative_log_likelihood:.4f} nats, "
            f"Brier {self.brier:.4f}",
            ["calibration error", ("value", ".4f"), ("95 % by chance", ".4f", "by_chance"), ("exceeds chance", "")],
            [(name, e.value, e.null_quantile, "yes" if e.exceeds_chance else "no") for name, e in errors.items()],
        )


_TITLES = {
    "ece_width": "ECE, equal width",
    "ece_mass": "ECE, equal mass",
    "ece_classwise": "ECE, classwise",
    "smooth": "smooth (smECE)",
}


def calibration_report(
    probs: ArrayLike,
    labels: ArrayLike,
    rng: np.random.Generator | None = None,
    num_bins: int = 15,
    num_resamples: int = 200,
) -> CalibrationReport:
    """Scores, calibration errors with their null quantiles, and the reliability curve.

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        rng: draws the labels for the null quantiles; seed 0 by default.
        num_bins: number of bins of the binned errors and of the curve.
        num_resamples: sets of labels for the null quantiles, about 7 ms each at n = 12 000.

    Raises:
        ValueError: as :func:`~belief.validation.checked_pair`; ``num_bins`` or ``num_resamples`` out of range.

    >>> rng = np.random.default_rng(0)
    >>> probs = np.repeat([[0.9, 0.1], [0.6, 0.4]], 500, axis=0)
    >>> labels = (rng.random(1000) > 0.75).astype(int)       # accuracy 75 % at any confidence
    >>> print(calibration_report(probs, labels))
    1000 rows, accuracy 0.7330, NLL 0.6672 nats, Brier 0.4448
    calibration error   value  95 % by chance  exceeds chance
    ─────────────────────────────────────────────────────────
    ECE, equal width   0.1630          0.0260  yes
    ECE, equal mass    0.1630          0.0291  yes
    ECE, classwise     0.1630          0.0280  yes
    smooth (smECE)     0.1253          0.0330  yes
    """
    p, y = checked_pair(probs, labels)
    generator = np.random.default_rng(0) if rng is None else rng

    def against_chance(metric: Metric) -> CalibrationError:
        return CalibrationError(metric(p, y), null_quantile(p, metric, generator, num_resamples=num_resamples))

    return CalibrationReport(
        num_rows=len(y),
        accuracy=accuracy(p, y),
        negative_log_likelihood=negative_log_likelihood(p, y),
        brier=brier_score(p, y),
        ece_width=against_chance(partial(expected_calibration_error, num_bins=num_bins)),
        ece_mass=against_chance(partial(expected_calibration_error, num_bins=num_bins, binning="mass")),
        ece_classwise=against_chance(partial(classwise_calibration_error, num_bins=num_bins)),
        smooth=against_chance(smooth_calibration_error),
        curve=reliability_curve(p, y, num_bins),
    )
