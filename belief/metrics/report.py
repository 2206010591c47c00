"""The calibration report: accuracy, proper scores and calibration errors with intervals."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from belief.metrics.binned import (
    classwise_calibration_error,
    debiased_calibration_error,
    expected_calibration_error,
)
from belief.metrics.brier import BrierDecomposition, brier_decomposition
from belief.metrics.inputs import checked_pair
from belief.metrics.null_distribution import Metric, null_quantile
from belief.metrics.reliability import ReliabilityCurve, reliability_curve
from belief.metrics.scores import accuracy, negative_log_likelihood
from belief.metrics.smooth import smooth_calibration_error


@dataclass(frozen=True)
class CalibrationError:
    """A calibration error beside what chance makes of it.

    Attributes:
        value: of the model.
        null_quantile: what a perfectly calibrated model with these predictions stays below in 95 % of cases.

    >>> CalibrationError(value=0.03, null_quantile=0.02).exceeds_chance
    True
    """

    value: float
    null_quantile: float

    @property
    def exceeds_chance(self) -> bool:
        """Whether a calibrated model would hardly score this."""
        return self.value > self.null_quantile


@dataclass(frozen=True, eq=False)
class CalibrationReport:
    """How good a model's probabilities are; prints as a table.

    Attributes:
        num_rows: n.
        accuracy: share of rows whose top shape is the true one.
        negative_log_likelihood: [nats]; infinite if a true shape had probability zero.
        brier: the Brier score (``brier.score``) and its terms.
        ece_width: expected calibration error of the top shape, bins of equal width.
        ece_mass: the same, bins of as many rows.
        ece_classwise: mean of the calibration errors of the single shapes.
        debiased: root mean square error less what chance adds; negative if chance would add more.
        smooth: smECE, which has no bins.
        curve: reliability curve of the top shape.
    """

    num_rows: int
    accuracy: float
    negative_log_likelihood: float
    brier: BrierDecomposition
    ece_width: CalibrationError
    ece_mass: CalibrationError
    ece_classwise: CalibrationError
    debiased: CalibrationError
    smooth: CalibrationError
    curve: ReliabilityCurve

    def to_dict(self) -> dict[str, Any]:
        """Nested plain dictionaries, lists and numbers; strict JSON has no word for an infinite likelihood.

        >>> calibration_report([[0.8, 0.2]] * 5, [0, 0, 0, 0, 1], num_resamples=20).to_dict()["curve"]["accuracy"]
        [0.8]
        """
        plain = asdict(self)
        plain["brier"]["score"] = self.brier.score
        plain["curve"] = {name: values.tolist() for name, values in plain["curve"].items()}
        return plain

    def __str__(self) -> str:
        lines = [
            f"{self.num_rows} rows, accuracy {self.accuracy:.4f}, NLL {self.negative_log_likelihood:.4f} nats",
            f"Brier {self.brier.score:.4f}: reliability {self.brier.reliability:.4f}, resolution "
            f"{self.brier.resolution:.4f}, uncertainty {self.brier.uncertainty:.4f}",
            "calibration error     value   95 % by chance",
        ]
        for name, title in _TITLES.items():
            error: CalibrationError = getattr(self, name)
            mark = "  exceeds chance" if error.exceeds_chance else ""
            lines.append(f"{title:<19} {error.value:>7.4f}   {error.null_quantile:>14.4f}{mark}")
        return "\n".join(lines)


_TITLES = {
    "ece_width": "ECE, equal width",
    "ece_mass": "ECE, equal mass",
    "ece_classwise": "ECE, classwise",
    "debiased": "RMS, debiased",
    "smooth": "smooth (smECE)",
}


def calibration_report(
    probs: ArrayLike,
    labels: ArrayLike,
    rng: np.random.Generator | None = None,
    num_bins: int = 15,
    num_resamples: int = 200,
) -> CalibrationReport:
    """Scores, calibration errors beside what chance makes of them, and the reliability curve.

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.
        rng: source of the labels behind the 95 % null quantiles; by default one that starts alike at every call, so
            that equal data give equal reports.
        num_bins: of the binned errors, of the Brier score's terms and of the curve.
        num_resamples: sets of labels behind the quantiles, about 7 ms each at n = 12 000.

    Raises:
        ValueError: rows that are no distributions, labels out of range, nothing at all, bins or resamples not positive.

    >>> rng = np.random.default_rng(0)
    >>> probs = np.repeat([[0.9, 0.1], [0.6, 0.4]], 500, axis=0)
    >>> labels = (rng.random(1000) > 0.75).astype(int)       # right in three of four rows, whatever was claimed
    >>> print(calibration_report(probs, labels))
    1000 rows, accuracy 0.7330, NLL 0.6672 nats
    Brier 0.4448: reliability 0.0537, resolution 0.0003, uncertainty 0.3914
    calibration error     value   95 % by chance
    ECE, equal width     0.1630           0.0260  exceeds chance
    ECE, equal mass      0.1630           0.0291  exceeds chance
    ECE, classwise       0.1630           0.0280  exceeds chance
    RMS, debiased        0.1627           0.0310  exceeds chance
    smooth (smECE)       0.1253           0.0270  exceeds chance
    """
    p, y = checked_pair(probs, labels)
    generator = np.random.default_rng(0) if rng is None else rng

    def against_chance(metric: Metric) -> CalibrationError:
        return CalibrationError(metric(p, y), null_quantile(p, metric, generator, num_resamples=num_resamples))

    return CalibrationReport(
        num_rows=len(y),
        accuracy=accuracy(p, y),
        negative_log_likelihood=negative_log_likelihood(p, y),
        brier=brier_decomposition(p, y, num_bins),
        ece_width=against_chance(partial(expected_calibration_error, num_bins=num_bins)),
        ece_mass=against_chance(partial(expected_calibration_error, num_bins=num_bins, binning="mass")),
        ece_classwise=against_chance(partial(classwise_calibration_error, num_bins=num_bins)),
        debiased=against_chance(partial(debiased_calibration_error, num_bins=num_bins)),
        smooth=against_chance(smooth_calibration_error),
        curve=reliability_curve(p, y, num_bins),
    )
