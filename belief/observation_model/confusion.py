"""The confusion model: frequencies of discrete outcomes, (predicted shape × confidence bin), by pose and shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.calibration import TemperatureScaling
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import Floats


@dataclass(frozen=True, eq=False)
class ConfusionModel(ArrayModel):
    """Per-pose confusion matrices over (predicted shape × confidence bin).

    Attributes:
        shape_labels: names of the K shapes.
        probs: p(outcome | pose, shape), ``(P, K, M)`` with M = K · number of bins; positive when fitted.
        calibration: gives the confidences that are binned.
        confidence_edges: ascending inner edges of the confidence bins; empty for the plain confusion matrix.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> logits = rng.normal(size=(400, 2)) + 3.0 * np.eye(2)[np.arange(400) % 2]
        >>> touches = [Touch(pose=0, logits=row) for row in logits]
        >>> model = ConfusionModel.fit(touches, np.arange(400) % 2, shape_labels=("cube", "cone"))
        >>> model.outcome_table().probs.round(2).tolist()         # outcomes: "cube", "cone"
        [[[0.98, 0.02], [0.02, 0.98]]]
    """

    name: ClassVar[str] = "confusion"

    shape_labels: tuple[str, ...]
    probs: Floats
    calibration: TemperatureScaling
    confidence_edges: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        probs = OutcomeTable(self.probs).probs
        if len(self.shape_labels) < 2:
            raise ValueError(f"need at least two shapes, got {self.shape_labels}")
        expected = len(self.shape_labels) * (len(self.confidence_edges) + 1)
        if probs.shape[1:] != (len(self.shape_labels), expected):
            raise ValueError(
                f"{len(self.shape_labels)} shapes and {len(self.confidence_edges)} confidence edges need probs of "
                f"shape (P, {len(self.shape_labels)}, {expected}), got {probs.shape}"
            )
        edges = np.array([1.0 / len(self.shape_labels), *self.confidence_edges, 1.0])
        if not (np.diff(edges) > 0.0).all():
            raise ValueError(f"confidence_edges must rise strictly within (1/K, 1), got {self.confidence_edges}")
        object.__setattr__(self, "probs", probs)
        self.freeze()

    @classmethod
    def fit(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike | None = None,
        *,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
        confidence_edges: Sequence[float] = (),
        smoothing: float = 0.5,
        pooling: float = 100.0,
    ) -> ConfusionModel:
        """Count the outcomes of calibration touches.

        The counts of each pose are shrunk towards the matrix pooled over all poses (Dirichlet prior of ``pooling``
        pseudo-counts, ≥ 0), and the pooled matrix towards a uniform one (``smoothing`` pseudo-counts per outcome, > 0).
        Other arguments and errors are those of :meth:`LabelledTouches.of`; ``object_ids`` has no effect.
        """
        if not 0.0 < smoothing < np.inf or not 0.0 <= pooling < np.inf:
            raise ValueError(f"smoothing must be > 0, pooling ≥ 0, both finite; got {smoothing} and {pooling}")
        data = LabelledTouches.of(touches, shapes, object_ids, shape_labels, num_poses)
        calibration = TemperatureScaling().fit_logits(data.logits, data.shapes)
        outcomes = _outcomes(calibration, data.logits, confidence_edges)
        counts = np.zeros((data.num_poses, data.num_shapes, data.num_shapes * (len(confidence_edges) + 1)))
        np.add.at(counts, (data.poses, data.shapes, outcomes), 1.0)
        pooled = counts.sum(axis=0) + smoothing
        pooled /= pooled.sum(axis=1, keepdims=True)
        probs = counts + pooling * pooled + np.finfo(float).tiny
        probs /= probs.sum(axis=2, keepdims=True)
        return cls(data.shape_labels, probs, calibration, tuple(float(edge) for edge in confidence_edges))

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.probs)

    def outcomes_of(self, logits: Floats) -> NDArray[np.int64]:
        """Outcome indices ``(...)`` of logits ``(..., K)``."""
        return _outcomes(self.calibration, logits, self.confidence_edges)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        """See :class:`ArrayModel`; the sum over touches."""
        outcomes = self.outcomes_of(batch.require_logits())
        return np.asarray(self._log_probs[batch.poses, :, outcomes].sum(axis=1))

    def weights_of_sums(self, num_touches: NDArray[np.int64]) -> Floats:
        """See :class:`ArrayModel`; touches are independent."""
        return np.ones(np.shape(num_touches))

    def statistics_with(self, statistics: Floats | None, touch: Touch) -> Floats:
        """The sum of log-likelihoods, ``(K,)``."""
        new = self._log_likelihoods(self.alone(touch))[0]
        return new if statistics is None else statistics + new

    def log_likelihood_of(self, statistics: Floats) -> Floats:
        """The sum itself."""
        return statistics

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`; the logits are typical of the sampled outcome."""
        cumulative = self.probs[:, shape].cumsum(axis=1)  # (P, M)
        drawn = rng.random(poses.shape)[..., None] * cumulative[poses][..., -1:]
        outcomes = (cumulative[poses] <= drawn).sum(axis=-1)
        return TouchBatch(poses, self._typical_logits[poses, outcomes])

    @cached_property
    def _log_probs(self) -> Floats:
        with np.errstate(divide="ignore"):
            return np.log(self.probs)

    @cached_property
    def _typical_logits(self) -> Floats:
        """Typical logits of each outcome, ``(P, M, K)``: calibrated, they give its precision, within its bin."""
        num_shapes = len(self.shape_labels)
        predicted = np.arange(self.probs.shape[2]) % num_shapes  # (M,)
        bins = np.arange(self.probs.shape[2]) // num_shapes
        edges = np.concatenate([[1.0 / num_shapes], self.confidence_edges, [1.0]])
        right = self.probs[:, predicted, np.arange(self.probs.shape[2])]  # (P, M)
        margin = 1e-9  # bins exclude their lower edge, and probability one has no finite logits
        low, high = edges[bins] + margin, np.minimum(edges[bins + 1], 1.0 - margin)
        confidence = np.clip(right / np.maximum(self.probs.sum(axis=1), np.finfo(float).tiny), low, high)
        floor = self.calibration.floor  # which the calibration adds again
        confidence = np.minimum((confidence - floor / num_shapes) / (1.0 - floor), 1.0 - margin)
        rest = (1.0 - confidence) / (num_shapes - 1)
        probs = np.where(predicted[:, None] == np.arange(num_shapes), confidence[..., None], rest[..., None])
        with np.errstate(over="ignore"):  # for a temperature near the largest float
            return np.clip(np.log(probs) * self.calibration.temperature, -np.finfo(float).max, 0.0)

    @property
    def default_outcomes(self) -> int:
        """M."""
        return self.probs.shape[2]

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; exact, or merged into fewer outcomes."""
        return OutcomeTable(self.probs).merged(num_outcomes)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        return {
            "confidence_edges": self.confidence_edges,
            **self.calibration.to_fields(),
            "probs": self.probs.tolist(),
        }

    @classmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> ConfusionModel:
        """See :class:`ArrayModel`."""
        calibration = TemperatureScaling.from_fields(fields)
        return cls(shape_labels, np.array(fields["probs"], np.float64), calibration, tuple(fields["confidence_edges"]))


def _outcomes(calibration: TemperatureScaling, logits: Floats, confidence_edges: Sequence[float]) -> NDArray[np.int64]:
    """Outcome indices ``(...)`` of logits ``(..., K)``."""
    if not len(confidence_edges):
        return logits.argmax(axis=-1)
    confidence = calibration.proba_of(logits).max(axis=-1)
    bins = np.searchsorted(np.asarray(confidence_edges, np.float64), confidence)
    return np.asarray(bins * logits.shape[-1] + logits.argmax(axis=-1), np.int64)
