"""Calibration of fused touches, and of searches that stop at a confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import softmax

from belief.metrics import CalibrationAtStop, CalibrationError, accuracy, calibration_at_stop, negative_log_likelihood
from belief.observation_model import ArrayModel, RatioModel
from belief.observation_model.registry import Fit
from belief.observation_model.repeat_discount import effective_touches
from belief.observation_model.selection import ModelChoice, choose_observation_model
from experiments.calibration.sequences import Sequences, stops
from experiments.calibration.touches import classwise_error, top_error
from experiments.sensor.scores import accuracy_of_objects

Floats = NDArray[np.float64]

UNDISCOUNTED = "independent"
"""Name of the ratio model without its discount: touches in one pose are taken as independent."""
_FUSED = 6  # largest number of touches with scores
_NEAR = 1e-4  # to an end of the weights tried


@dataclass(frozen=True)
class Fused:
    """Scores of the posterior after a number of touches of one kind of sequence, under a uniform prior."""

    num_touches: int
    accuracy: float
    nll: float
    ece: CalibrationError
    classwise: CalibrationError


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


@dataclass(frozen=True)
class Weight:
    """Weight of the mean evidence of n touches in one pose, in touches.

    Attributes:
        num_touches: n.
        free: weight that maximises the likelihood of the true shapes.
        low: lower bound of its 95 % interval, clustered by object; None where the likelihood has no maximum between 0
            and 2 n, as where all touches are read right.
        high: upper bound, likewise.
        discounted: n / (1 + (n - 1) ρ), the weight of the ratio model.
    """

    num_touches: int
    free: float
    low: float | None
    high: float | None
    discounted: float

    @property
    def words(self) -> str:
        """The best weight and its interval, or the end beyond which it lies."""
        if self.low is None or self.high is None:
            return f"{'≥' if self.free > self.num_touches else '≤'} {self.free:.3f}"
        return f"{self.free:.3f} [{self.low:.3f}, {self.high:.3f}]"


def fit_model(name: str, fit: Fit, touches: Sequences, shape_labels: tuple[str, ...], num_poses: int) -> ModelChoice:
    """Fit an observation model to single touches of the calibration split, and compute its cross-validated NLL.

    Args:
        name: of the model.
        fit: fits it.
        touches: single touches.
        shape_labels: names of the shapes.
        num_poses: number of poses.
    """
    return choose_observation_model(
        touches.batch.reshaped((1, -1)).sequence(0),
        touches.shapes,
        touches.object_ids,
        shape_labels=shape_labels,
        num_poses=num_poses,
        candidates={name: fit},
    )


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
    for kind, some in sequences.items():
        log_probs = some.log_posteriors(model)
        probs = np.exp(log_probs[:, :_FUSED])
        fused[kind] = [_fused(n + 1, probs[:, n], some.shapes, rng) for n in range(probs.shape[1])]
        stopped[kind] = _stops(log_probs, some, confidence, rng)
    return ModelScores(name, loss, fused, stopped)


def _fused(num_touches: int, probs: Floats, shapes: NDArray[np.int64], rng: np.random.Generator) -> Fused:
    right, nll = accuracy(probs, shapes), negative_log_likelihood(probs, shapes)
    return Fused(num_touches, right, nll, top_error(probs, shapes, rng), classwise_error(probs, shapes, rng))


def _stops(log_probs: Floats, sequences: Sequences, confidence: float, rng: np.random.Generator) -> StopScores:
    found = stops(log_probs, sequences.shapes, confidence)
    if not len(found.sequences):
        return StopScores(len(sequences), None, None)
    right = accuracy_of_objects(found.correct, sequences.object_ids[found.sequences], rng)
    return StopScores(len(sequences), calibration_at_stop(found.claims, found.correct, found.num_touches), right)


def free_weights(model: RatioModel, sequences: Sequences) -> list[Weight]:
    """Maximum-likelihood weights of repeated touches in these sequences, and the weights of the model.

    Intervals are sandwich estimates with objects as clusters (White 1982; Liang & Zeger 1986).
    """
    alone, found = replace(model, correlation=0.0), []
    for n in range(1, sequences.batch.num_touches + 1):
        evidence = alone.log_likelihood_batch(sequences.batch.first(n)) / n
        evidence -= np.take_along_axis(evidence, sequences.shapes[:, None], axis=1)  # against the true shape

        def loss(weight: float, evidence: Floats = evidence) -> float:
            return float(np.logaddexp.reduce(weight * evidence, axis=1).mean())

        free = float(minimize_scalar(loss, bounds=(0.0, 2.0 * n), method="bounded", options={"xatol": 1e-6}).x)
        discounted = float(effective_touches(n, model.correlation))
        if not _NEAR < free < 2.0 * n - _NEAR:
            found.append(Weight(n, free, None, None, discounted))
            continue
        probs = softmax(free * evidence, axis=1)
        slopes = (probs * evidence).sum(axis=1)
        curvature = float(((probs * evidence**2).sum(axis=1) - slopes**2).sum())
        spread = float(np.sqrt((np.bincount(sequences.object_ids, slopes) ** 2).sum()))
        reach = 1.96 * spread / curvature if curvature > 0.0 else np.inf
        found.append(Weight(n, free, free - reach, free + reach, discounted))
    return found
