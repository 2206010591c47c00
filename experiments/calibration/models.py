"""Calibration of fused touches, and of searches that stop at a confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief.metrics import CalibrationAtStop, CalibrationError, accuracy, calibration_at_stop, negative_log_likelihood
from belief.metrics.calibration_at_stop import stops
from belief.observation_model.model import ArrayModel
from experiments.calibration.sequences import Sequences
from experiments.calibration.touches import top_error
from experiments.sensor.scores import accuracy_of_objects

Floats = NDArray[np.float64]

UNDISCOUNTED = "independent"
"""Name of the ratio model without its discount: touches in one pose are taken as independent."""
_FUSED = 6  # largest number of touches with scores


@dataclass(frozen=True)
class Fused:
    """Scores of the posterior after a number of touches of one kind of sequence, under a uniform prior."""

    num_touches: int
    accuracy: float
    nll: float
    ece: CalibrationError


@dataclass(frozen=True)
class StopScores:
    """Scores at stopping of one kind of sequence.

    Attributes:
        num_sequences: number of sequences, stopped or not.
        claims: stated confidence and accuracy, with Clopper-Pearson intervals; None if none stopped.
        right: accuracy and its interval, resampling objects; None if none stopped.
    """

    num_sequences: int
    claims: CalibrationAtStop | None
    right: tuple[float, float, float] | None


@dataclass(frozen=True)
class ModelScores:
    """Scores of an observation model on test sequences.

    Attributes:
        name: name of the model.
        cross_validated_nll: loss on sequences of the calibration split [nats]; None for :data:`UNDISCOUNTED`.
        fused: scores after 1, 2, … touches, by kind of sequence.
        stops: scores at stopping, by kind of sequence.
    """

    name: str
    cross_validated_nll: float | None
    fused: Mapping[str, Sequence[Fused]]
    stops: Mapping[str, StopScores]


def score_model(
    name: str,
    model: ArrayModel,
    loss: float | None,
    sequences: Mapping[str, Sequences],
    confidence: float,
    rng: np.random.Generator,
) -> ModelScores:
    """Scores of a model by number of touches and at stopping, for every kind of sequence.

    Args:
        name: name of the model.
        model: the fitted model.
        loss: its cross-validated NLL, or None.
        sequences: test sequences by kind.
        confidence: posterior at which a search stops.
        rng: random generator for null quantiles and intervals.
    """
    fused, stopped = {}, {}
    for kind, of_kind in sequences.items():
        log_probs, shapes = of_kind.log_posteriors(model), of_kind.shapes
        after = np.exp(log_probs[:, :_FUSED]).swapaxes(0, 1)
        fused[kind] = [
            Fused(n, accuracy(probs, shapes), negative_log_likelihood(probs, shapes), top_error(probs, shapes, rng))
            for n, probs in enumerate(after, 1)
        ]
        stopped[kind] = _stops(log_probs, of_kind, confidence, rng)
    return ModelScores(name, loss, fused, stopped)


def _stops(log_probs: Floats, sequences: Sequences, confidence: float, rng: np.random.Generator) -> StopScores:
    found = stops(log_probs, sequences.shapes, confidence)
    if not len(found.sequences):
        return StopScores(len(sequences), None, None)
    right = accuracy_of_objects(found.correct, sequences.object_ids[found.sequences], rng)
    return StopScores(len(sequences), calibration_at_stop(found.claims, found.correct, found.num_touches), right)
