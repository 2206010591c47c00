"""Calibration of single touches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from belief.calibration import CALIBRATIONS, TemperatureScaling, choose_calibration
from belief.metrics import (
    CalibrationError,
    CalibrationReport,
    bias_corrected_interval,
    calibration_report,
    classwise_calibration_error,
    expected_calibration_error,
    null_quantile,
)
from experiments.calibration.sequences import Sequences

Floats = NDArray[np.float64]
Predict: TypeAlias = Callable[[Sequences], Floats]
"""Function from single touches to probabilities ``(S, K)``."""

NULL_RESAMPLES = 200
"""Number of sets of labels drawn for every null quantile."""
_FOLDS = 5


@dataclass(frozen=True, eq=False)
class TouchScores:
    """Scores of single test touches under one calibration.

    Attributes:
        name: name of the calibration.
        cross_validated_nll: loss on the calibration split [nats]; None for the raw softmax, which is not fitted.
        report: scores, calibration errors with their null quantiles, and the reliability curve.
        classwise: bias-corrected calibration error and its 95 % interval, which resamples objects.
    """

    name: str
    cross_validated_nll: float | None
    report: CalibrationReport
    classwise: tuple[float, float, float]


def fit_raw(touches: Sequences) -> tuple[Predict, None]:
    """The softmax of the classifier, without calibration."""
    return lambda asked: TemperatureScaling().predict_proba(asked.batch.require_logits()[:, 0]), None


def fit_pooled(name: str, touches: Sequences) -> tuple[Predict, float]:
    """A calibration by name, fitted to all poses together, and its cross-validated NLL over objects."""
    candidates = {name: CALIBRATIONS[name]()}
    logits = touches.batch.require_logits()[:, 0]
    choice = choose_calibration(logits, touches.shapes, touches.object_ids, candidates, _FOLDS)
    return lambda asked: choice.calibration.predict_proba(asked.batch.require_logits()[:, 0]), choice.losses[name]


RAW = "raw softmax"
CALIBRATION_FITS: Mapping[str, Callable[[Sequences], tuple[Predict, float | None]]] = {
    RAW: fit_raw,
    **{name: partial(fit_pooled, name) for name in CALIBRATIONS},
}
"""Functions that fit a calibration to the calibration split, by name."""


def score_touches(
    name: str, known: Sequences, test: Sequences, rng: np.random.Generator, num_resamples: int
) -> TouchScores:
    """Fit a calibration to known touches and score it on test touches.

    Args:
        name: a key of :data:`CALIBRATION_FITS`.
        known: single touches of the calibration split.
        test: single touches of other objects.
        rng: random generator for null quantiles and intervals.
        num_resamples: bootstrap samples of an interval.
    """
    predict, loss = CALIBRATION_FITS[name](known)
    probs, metric = predict(test), classwise_calibration_error
    report = calibration_report(probs, test.shapes, rng, num_resamples=NULL_RESAMPLES)
    interval = bias_corrected_interval(probs, test.shapes, metric, rng, test.object_ids, num_resamples=num_resamples)
    return TouchScores(name, loss, report, interval)


def top_error(probs: Floats, labels: NDArray[np.int64], rng: np.random.Generator) -> CalibrationError:
    """Expected calibration error of the most likely shape, with its null quantile."""
    chance = null_quantile(probs, expected_calibration_error, rng, num_resamples=NULL_RESAMPLES)
    return CalibrationError(expected_calibration_error(probs, labels), chance)
