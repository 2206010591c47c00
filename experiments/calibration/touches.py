"""Calibration of single touches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from belief.calibration import CALIBRATIONS, PerPose, TemperatureScaling, choose_calibration
from belief.cross_validation import object_folds
from belief.metrics import (
    CalibrationError,
    CalibrationReport,
    accuracy,
    bias_corrected_interval,
    calibration_report,
    classwise_calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
    null_quantile,
)
from experiments.calibration.sequences import Sequences

Floats = NDArray[np.float64]
Predict: TypeAlias = Callable[[Sequences], Floats]
"""Function from single touches to probabilities ``(S, K)``."""

NULL_RESAMPLES = 200
"""Number of sets of labels drawn for every null quantile."""
_FOLDS = 5


@dataclass(frozen=True)
class GroupScores:
    """Scores of the touches in one pose, or of one shape.

    Attributes:
        accuracy: accuracy of the touches.
        nll: mean negative log-likelihood [nats].
        ece: for a pose, of the most likely shape; for a shape, of its own probability over all touches.
    """

    accuracy: float
    nll: float
    ece: CalibrationError


@dataclass(frozen=True, eq=False)
class TouchScores:
    """Scores of single test touches under one calibration.

    Attributes:
        name: name of the calibration.
        cross_validated_nll: loss on the calibration split [nats]; None for the raw softmax, which is not fitted.
        report: scores, calibration errors with their null quantiles, and the reliability curve.
        classwise: bias-corrected calibration error and its 95 % interval, which resamples objects.
        poses: scores by name of the pose.
        shapes: scores by name of the shape.
    """

    name: str
    cross_validated_nll: float | None
    report: CalibrationReport
    classwise: tuple[float, float, float]
    poses: Mapping[str, GroupScores]
    shapes: Mapping[str, GroupScores]


def fit_raw(touches: Sequences) -> tuple[Predict, None]:
    """The softmax of the classifier, without calibration."""
    return lambda some: TemperatureScaling().predict_proba(some.batch.logits[:, 0]), None


def fit_pooled(name: str, touches: Sequences) -> tuple[Predict, float]:
    """A calibration by name, fitted to all poses together, and its cross-validated NLL over objects."""
    candidates = {name: CALIBRATIONS[name]()}
    logits = touches.batch.require_logits()[:, 0]
    choice = choose_calibration(logits, touches.shapes, touches.object_ids, candidates, _FOLDS)
    return lambda some: choice.calibration.predict_proba(some.batch.logits[:, 0]), choice.losses[name]


def fit_by_pose(touches: Sequences) -> tuple[Predict, float]:
    """One calibration per pose, and its cross-validated NLL over objects."""
    logits, poses, shapes = touches.batch.require_logits()[:, 0], touches.batch.poses[:, 0], touches.shapes
    num_poses, losses = int(poses.max()) + 1, np.empty(len(shapes))
    folds = object_folds(shapes, touches.object_ids, _FOLDS)
    for fold in range(_FOLDS):
        held = folds == fold
        fitted = PerPose().fit(logits[~held], shapes[~held], poses[~held], num_poses)
        log_probs = fitted.predict_log_proba(logits[held], poses[held])
        losses[held] = -log_probs[np.arange(len(log_probs)), shapes[held]]
    every = PerPose().fit(logits, shapes, poses, num_poses)
    return lambda some: every.predict_proba(some.batch.require_logits()[:, 0], some.batch.poses[:, 0]), float(
        losses.mean()
    )


RAW = "raw softmax"
CALIBRATION_FITS: Mapping[str, Callable[[Sequences], tuple[Predict, float | None]]] = {
    RAW: fit_raw,
    **{name: partial(fit_pooled, name) for name in CALIBRATIONS},
    "structured_matrix, by pose": fit_by_pose,
}
"""Functions that fit a calibration to the calibration split, by name."""


def score_touches(
    name: str,
    known: Sequences,
    test: Sequences,
    labels: tuple[tuple[str, ...], tuple[str, ...]],
    rng: np.random.Generator,
    num_resamples: int,
) -> TouchScores:
    """Fit a calibration to known touches and score it on test touches.

    Args:
        name: a key of :data:`CALIBRATION_FITS`.
        known: single touches of the calibration split.
        test: single touches of other objects.
        labels: names of the shapes and of the poses.
        rng: random generator for null quantiles and intervals.
        num_resamples: bootstrap samples of an interval.
    """
    predict, loss = CALIBRATION_FITS[name](known)
    probs, poses, shapes = predict(test), test.batch.poses[:, 0], test.shapes
    shape_labels, pose_labels = labels
    of_poses, of_shapes = {}, {}
    for pose, label in enumerate(pose_labels):
        here = poses == pose
        of_poses[label] = _part(probs[here], shapes[here], top_error(probs[here], shapes[here], rng))
    for shape, label in enumerate(shape_labels):
        here = shapes == shape
        is_it = np.stack([1.0 - probs[:, shape], probs[:, shape]], axis=1)
        of_shapes[label] = _part(probs[here], shapes[here], classwise_error(is_it, here.astype(np.int64), rng))
    return TouchScores(
        name,
        loss,
        calibration_report(probs, shapes, rng, num_resamples=NULL_RESAMPLES),
        bias_corrected_interval(
            probs, shapes, classwise_calibration_error, rng, test.object_ids, num_resamples=num_resamples
        ),
        of_poses,
        of_shapes,
    )


def _part(probs: Floats, shapes: NDArray[np.int64], error: CalibrationError) -> GroupScores:
    return GroupScores(accuracy(probs, shapes), negative_log_likelihood(probs, shapes), error)


def top_error(probs: Floats, labels: NDArray[np.int64], rng: np.random.Generator) -> CalibrationError:
    """Expected calibration error of the most likely shape, with its null quantile."""
    return _against_chance(expected_calibration_error, probs, labels, rng)


def classwise_error(probs: Floats, labels: NDArray[np.int64], rng: np.random.Generator) -> CalibrationError:
    """Mean calibration error over shapes, with its null quantile."""
    return _against_chance(classwise_calibration_error, probs, labels, rng)


def _against_chance(
    metric: Callable[..., float], probs: Floats, labels: NDArray[Any], rng: np.random.Generator
) -> CalibrationError:
    chance = null_quantile(probs, metric, rng, num_resamples=NULL_RESAMPLES)
    return CalibrationError(metric(probs, labels), chance)
