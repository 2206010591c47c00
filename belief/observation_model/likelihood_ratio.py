r"""The default observation model: calibrated posterior divided by the training prior, with repeats discounted.

    log p(x | k) = log q(k | x) - log π_k + log p(x)                     (Bayes' rule)

No density over images or logits is needed. Touches of one object in *different* poses are treated as independent given
the shape. n touches in *one* pose count as n / (1 + (n - 1) ρ) touches with their mean log ratio, where ρ is fitted to
objects that were touched repeatedly (decision 0002).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from belief.calibration import CALIBRATIONS, Calibration, StructuredMatrixScaling
from belief.codec import OneOf, Stored
from belief.constraints import Within, check
from belief.observation_model.calibration_data import LabelledTouches, object_folds
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_table import OutcomeTable, drawn, smoothed, tabulate
from belief.observation_model.repeat_discount import (
    ASSUMED_CORRELATION,
    effective_touches,
    fit_correlation,
    repeat_shares,
    repeats,
)
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import SUM_TOLERANCE, Floats, as_real, renormalised

Status: TypeAlias = Literal["ok", "no_repeats", "one_shape"]
_REFERENCES = 500  # touches stored per pose
_POOLING = 100.0  # weight of the table of all poses in that of each pose, in touches


@dataclass(frozen=True, eq=False)
class RatioModel(ArrayModel):
    """Calibrated posterior over training prior, with repeats discounted.

    Attributes:
        shape_labels: names of the K shapes.
        calibration: from logits to q(shape | touch).
        training_prior: π, fraction of each shape among the touches of the fit, ``(K,)``.
        correlation: ρ of touches of an object in one pose, in [0, 1).
        references: logits of N representative touches per pose, ``(P, N, K)``; used only by sampling and tables.
        status: ``ok``; ``no_repeats``: ρ is assumed, because no objects of two shapes were touched twice in a pose;
            ``one_shape``: all touches were of one shape, from which no ratio of two shapes can be learned. The
            calibration then fits the frequencies of this shape only; its own status may be any.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> shapes, ids = np.arange(900) // 3 % 2, np.arange(900) // 3       # three equal touches of each object
        >>> logits = 2.0 * np.eye(2)[shapes] + rng.normal(size=(300, 2))[ids]
        >>> model = RatioModel.fit([Touch(0, row) for row in logits], shapes, ids)
        >>> model.status, bool(model.correlation > 0.9)
        ('ok', True)
    """

    name: ClassVar[str] = "ratio"
    last_in_file: ClassVar = ("references",)

    shape_labels: tuple[str, ...]
    calibration: Annotated[Calibration, OneOf(CALIBRATIONS)]
    training_prior: Floats
    correlation: Annotated[float, Within(0.0, 1.0, open_high=True)]
    references: Annotated[Floats, Stored("float32", is_decimal=True)]
    status: Status = "ok"

    def __post_init__(self) -> None:
        self.to_floats("references")
        prior, references = np.asarray(as_real(self.training_prior, "training_prior"), np.float64), self.references
        num_shapes = len(self.shape_labels)
        if prior.shape != (num_shapes,) or not (prior > 0.0).all() or abs(prior.sum() - 1.0) > SUM_TOLERANCE:
            raise ValueError(f"training_prior must be {num_shapes} positive shares that sum to one, got {prior}")
        check(self)
        if references.ndim != 3 or references.shape[2] != num_shapes or references.size == 0:
            raise ValueError(f"references must be (P, N, {num_shapes}), none of them empty, got {references.shape}")
        if self.calibration.num_shapes not in (None, num_shapes):
            raise ValueError(f"the calibration is for {self.calibration.num_shapes} shapes, not for {num_shapes}")
        object.__setattr__(self, "training_prior", renormalised(prior))
        self.freeze()

    @classmethod
    def fit_to(cls, data: LabelledTouches, *, calibration: Calibration | None = None, num_folds: int = 5) -> RatioModel:
        """Fit the calibration to all touches, and ρ to cross-fitted posteriors.

        ``calibration`` is unfitted, by default structured matrix scaling. ``num_folds`` is the number of folds of whole
        objects in which ρ is cross-fitted.
        """
        unfitted = calibration if calibration is not None else StructuredMatrixScaling()
        calibrated = unfitted.fit_logits(data.logits, data.shapes)
        prior = _training_prior(calibrated, data)
        found, correlation = repeats(data), ASSUMED_CORRELATION
        if found is not None:
            log_ratio = _cross_fitted(unfitted, data, num_folds) - np.log(prior)
            sums = np.where((found.rows >= 0)[..., None], log_ratio[found.rows], 0.0).cumsum(axis=1)[:, 1:]
            number = np.arange(2, sums.shape[1] + 2)
            correlation = fit_correlation(lambda rho: sums * (effective_touches(number, rho) / number)[:, None], found)
        return cls(
            data.shape_labels,
            calibrated,
            prior,
            correlation,
            _references(data),
            "one_shape" if np.count_nonzero(data.counts) == 1 else "no_repeats" if found is None else "ok",
        )

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.references)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        log_ratio = self._log_ratio(batch)
        if batch.num_touches == 1:
            return log_ratio[:, 0]
        shares = repeat_shares(batch.poses, self.correlation)
        return _within_floats((shares[:, None] @ log_ratio)[:, 0])

    def statistics_with(self, statistics: _Means | None, touch: Touch) -> _Means:
        """The mean log ratio in each pose, in the order of their first touches."""
        batch = self.alone(touch)
        log_ratio, pose = self._log_ratio(batch)[0], int(batch.poses[0, 0])
        if statistics is None:
            return _Means((pose,), np.ones(1), log_ratio)
        poses, counts, means = statistics
        if pose not in poses:
            return _Means((*poses, pose), np.append(counts, 1.0), np.concatenate([means, log_ratio]))
        place, counts, means = poses.index(pose), counts.copy(), means.copy()
        counts[place] += 1.0
        means[place] += (log_ratio[0] - means[place]) / counts[place]
        return _Means(poses, counts, means)

    def log_likelihood_of(self, statistics: _Means) -> Floats:
        """The sum over poses of the mean log ratio times the effective number of touches."""
        counts, means = statistics.counts, statistics.means
        return _within_floats((effective_touches(counts, self.correlation)[:, None] * means).sum(axis=0))

    def _log_ratio(self, batch: TouchBatch) -> Floats:
        return self.calibration.log_proba(batch.require_logits()) - self._log_prior

    def weights_of_sums(self, num_touches: NDArray[np.int64]) -> Floats:
        """See :class:`ArrayModel`."""
        return effective_touches(num_touches, self.correlation) / np.maximum(num_touches, 1)

    @property
    def repeat_correlation(self) -> float:
        """See :class:`ArrayModel`."""
        return self.correlation

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`; independent draws of references, weighted by their likelihood of the shape."""
        return TouchBatch(poses, self.references[poses, drawn(self._weights[:, :, shape], poses, rng)])

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; the references clustered by posterior, with each pose shrunk towards all poses."""
        log_posteriors = self.calibration.log_proba(self.references) - self._log_prior
        log_posteriors -= np.logaddexp.reduce(log_posteriors, axis=-1, keepdims=True)
        table = tabulate(log_posteriors, self._weights, num_outcomes, rng)
        number = self.references.shape[1] * self.training_prior[:, None]  # touches of each shape in a pose
        pooled = smoothed(table.mean(axis=0), self.num_poses * number)
        return OutcomeTable((number * table + _POOLING * pooled) / (number + _POOLING))

    @cached_property
    def _log_prior(self) -> Floats:
        return np.log(self.training_prior)

    @cached_property
    def _weights(self) -> Floats:
        """Weight of each reference for each shape, ``(P, N, K)``; sums to one over N."""
        probs = np.exp(self.calibration.log_proba(self.references))
        return np.asarray(probs / probs.sum(axis=1, keepdims=True))


class _Means(NamedTuple):
    """Poses, their numbers of touches, ``(p,)``, and their mean log ratios, ``(p, K)``."""

    poses: tuple[int, ...]
    counts: Floats
    means: Floats


def _within_floats(log_likelihoods: Floats) -> Floats:
    """Log-likelihoods limited to finite floats, so that no shape becomes impossible."""
    return np.maximum(log_likelihoods, -np.finfo(np.float64).max)


def _training_prior(calibrated: Calibration, data: LabelledTouches) -> Floats:
    """Fraction of each shape, ``(K,)``; for a shape without touches, its mean probability by the calibration."""
    predicted = np.maximum(np.exp(calibrated.log_proba(data.logits)).mean(axis=0), np.finfo(float).tiny)
    shares = np.where(data.counts > 0, data.counts / len(data.shapes), predicted)
    return np.asarray(shares / shares.sum())


def _cross_fitted(unfitted: Calibration, data: LabelledTouches, num_folds: int) -> Floats:
    """Log probabilities ``(n, K)`` of touches, each by a calibration fitted to other objects, if there are any."""
    folds = object_folds(data.shapes, data.objects, min(num_folds, data.num_objects))
    found = np.empty_like(data.logits)
    for fold in np.unique(folds).tolist():
        kept, held = folds != fold, folds == fold
        fitted = unfitted.fit_logits(data.logits[kept], data.shapes[kept]) if kept.any() else unfitted
        found[held] = fitted.log_proba(data.logits[held])
    return found


def _references(data: LabelledTouches) -> Floats:
    """500 touches per pose, evenly spaced in the data, in single precision; of all poses where a pose has none."""
    chosen = data.logits[data.rows_of_poses(_REFERENCES)]
    # Logits beyond single precision are stored relative to the largest in the row, which does not change a softmax.
    with np.errstate(over="ignore"):
        below = np.maximum(chosen - chosen.max(axis=-1, keepdims=True), np.finfo(np.float32).min)
    fits = (np.abs(chosen) <= np.finfo(np.float32).max).all(axis=-1, keepdims=True)
    return np.where(fits, chosen, below).astype(np.float32).astype(np.float64)
