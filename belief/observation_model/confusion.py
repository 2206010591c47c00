"""The confusion model: how often each shape is predicted, by pose and true shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from belief.calibration import TemperatureScaling
from belief.codec import Merged
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_table import OutcomeTable, merged
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import Floats


@dataclass(frozen=True, eq=False)
class ConfusionModel(ArrayModel):
    """A confusion matrix for each pose.

    Attributes:
        shape_labels: names of the K shapes.
        probs: p(predicted shape | pose, shape), ``(P, K, K)``; positive when fitted.
        calibration: calibration of the logits, by which samples get logits.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> logits = rng.normal(size=(400, 2)) + 3.0 * np.eye(2)[np.arange(400) % 2]
        >>> touches = [Touch(pose=0, logits=row) for row in logits]
        >>> model = ConfusionModel.fit(touches, np.arange(400) % 2, shape_labels=("cube", "cone"))
        >>> model.outcome_table().probs.round(2).tolist()         # outcomes: "cube", "cone"
        [[[0.98, 0.02], [0.02, 0.98]]]
    """

    name: ClassVar[str] = "confusion"
    last_in_file: ClassVar = ("probs",)

    shape_labels: tuple[str, ...]
    probs: Floats
    calibration: Annotated[TemperatureScaling, Merged()]

    def __post_init__(self) -> None:
        probs = OutcomeTable(self.probs).probs
        if len(self.shape_labels) < 2:
            raise ValueError(f"need at least two shapes, got {self.shape_labels}")
        if probs.shape[2] != len(self.shape_labels) or probs.shape[1] != len(self.shape_labels):
            number = len(self.shape_labels)
            raise ValueError(f"{number} shapes need probs of shape (P, {number}, {number}), got {probs.shape}")
        object.__setattr__(self, "probs", probs)
        self.freeze()

    @classmethod
    def fit_to(cls, data: LabelledTouches, *, smoothing: float = 0.5, pooling: float = 100.0) -> ConfusionModel:
        """Count the outcomes of calibration touches, whatever their objects.

        The counts of each pose are shrunk towards the matrix pooled over all poses (Dirichlet prior of ``pooling``
        pseudo-counts, ≥ 0), and the pooled matrix towards a uniform one (``smoothing`` pseudo-counts per outcome, > 0).
        """
        if not 0.0 < smoothing < np.inf or not 0.0 <= pooling < np.inf:
            raise ValueError(f"smoothing must be > 0, pooling ≥ 0, both finite; got {smoothing} and {pooling}")
        calibration = TemperatureScaling().fit_logits(data.logits, data.shapes)
        counts = np.zeros((data.num_poses, data.num_shapes, data.num_shapes))
        np.add.at(counts, (data.poses, data.shapes, data.logits.argmax(axis=1)), 1.0)
        pooled = counts.sum(axis=0) + smoothing
        pooled /= pooled.sum(axis=1, keepdims=True)
        probs = counts + pooling * pooled + np.finfo(float).tiny
        probs /= probs.sum(axis=2, keepdims=True)
        return cls(data.shape_labels, probs, calibration)

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.probs)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        """See :class:`ArrayModel`; the sum over touches."""
        outcomes = batch.require_logits().argmax(axis=-1)
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
        """Typical logits of each predicted shape, ``(P, K, K)``: calibrated, they give its precision."""
        num_shapes, margin = len(self.shape_labels), 1e-9  # probability one has no finite logits
        right = np.diagonal(self.probs, axis1=1, axis2=2)  # (P, K)
        precision = right / np.maximum(self.probs.sum(axis=1), np.finfo(float).tiny)
        confidence = np.clip(precision, 1.0 / num_shapes + margin, 1.0 - margin)
        floor = self.calibration.floor  # which the calibration adds again
        confidence = np.minimum((confidence - floor / num_shapes) / (1.0 - floor), 1.0 - margin)
        rest = (1.0 - confidence) / (num_shapes - 1)
        probs = np.where(np.eye(num_shapes, dtype=bool), confidence[..., None], rest[..., None])
        with np.errstate(over="ignore"):  # for a temperature near the largest float
            return np.clip(np.log(probs) * self.calibration.temperature, -np.finfo(float).max, 0.0)

    @property
    def default_outcomes(self) -> int:
        """M."""
        return self.probs.shape[2]

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; exact, or merged into fewer outcomes."""
        return merged(OutcomeTable(self.probs), num_outcomes, rng)
