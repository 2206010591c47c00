"""Proper scores and calibration errors of predicted distributions ``probs (n, K)`` for labels ``(n,)``.

Estimates of the calibration error are positive by chance. Compare them with the null quantile: the error of a perfectly
calibrated model with the same predictions.

    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> logits = 2.0 * rng.normal(size=(600, 3))
    >>> probs = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    >>> labels = (rng.random(600)[:, None] > probs.cumsum(axis=1)).sum(axis=1)  # drawn from probs
    >>> error = expected_calibration_error(probs, labels)
    >>> error < null_quantile(probs, expected_calibration_error, rng, num_resamples=200)
    True
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from belief.metrics.calibration_at_stop import CalibrationAtStop, StopScore, calibration_at_stop
from belief.naming import later

if TYPE_CHECKING:
    from belief.metrics.report import (
        CalibrationError,
        CalibrationReport,
        ReliabilityCurve,
        calibration_report,
        null_quantile,
        reliability_curve,
        reliability_diagram,
    )
    from belief.metrics.scores import (
        ShapeScore,
        accuracy,
        brier_score,
        classwise_calibration_error,
        confusion_matrix,
        expected_calibration_error,
        negative_log_likelihood,
        shape_scores,
        smooth_calibration_error,
    )

__all__ = [
    "CalibrationAtStop",
    "CalibrationError",
    "CalibrationReport",
    "ReliabilityCurve",
    "ShapeScore",
    "StopScore",
    "accuracy",
    "brier_score",
    "calibration_at_stop",
    "calibration_report",
    "classwise_calibration_error",
    "confusion_matrix",
    "expected_calibration_error",
    "negative_log_likelihood",
    "null_quantile",
    "reliability_curve",
    "reliability_diagram",
    "shape_scores",
    "smooth_calibration_error",
]

__getattr__, __dir__ = later(__name__)
