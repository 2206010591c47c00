"""The calibration report: accuracy, proper scores and calibration errors with intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.metrics.binned import classwise_calibration_error, expected_calibration_error, smooth_calibration_error
from belief.metrics.reliability import ReliabilityCurve, reliability_curve
from belief.metrics.scores import accuracy, brier_score, negative_log_likelihood
from belief.table import Table, Tabular
from belief.validation import Floats, checked_pair, checked_probs, require_count, require_fraction

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
    require_count("num_resamples", num_resamples)
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
        value: of the model.
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
        num_bins: of the binned errors and the curve.
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
