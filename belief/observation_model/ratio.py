r"""From a calibrated posterior to a likelihood: divide by the training prior, and discount repeats.

    log p(x | k) = log q(k | x) - log π_k + log p(x)                     (Bayes' rule, read backwards)

No density over images or logits is needed, and one touch is exactly as trustworthy as the calibration q. Touches of one
object in *different* poses are taken for independent given the shape; n touches in *one* pose, which show the same face
again, count as n / (1 + (n - 1) ρ) touches of their mean: one number ρ, fitted to objects that were touched repeatedly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.batch import TouchBatch
from belief.calibration import CALIBRATIONS, Calibration, StructuredMatrixScaling
from belief.folds import object_folds
from belief.observation_model.model import ArrayModel, calibration_arrays, labels_or_default
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.quantisation import DEFAULT_OUTCOMES, cluster, nearest
from belief.observation_model.repeats import effective_touches, fit_correlation, repeats
from belief.problem import Floats, Touch

Status: TypeAlias = Literal["ok", "no_repeats"]
_REFERENCES = 500  # touches kept of each pose
_POOLING = 100.0  # weight of all poses' table in one pose's, in touches
_SMOOTHING = 0.5  # pseudo-counts an outcome in the table of all poses


@dataclass(frozen=True, eq=False)
class RatioModel(ArrayModel):
    """Calibrated posterior over training prior, with repeats discounted.

    Attributes:
        shape_labels: names of the K shapes.
        calibration: from logits to q(shape | touch).
        training_prior: π, shares of the shapes among the touches that the calibration was fitted on, ``(K,)``.
        correlation: ρ, between touches of an object in one pose, in [0, 1).
        references: logits of touches that stand for all, of each pose as many, ``(P, N, K)``; used to sample and to
            tabulate only.
        status: ``ok``; ``no_repeats``: no object was touched twice in a pose, and ρ is assumed.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> shapes, ids = np.arange(900) // 3 % 2, np.arange(900) // 3       # three touches of each object
        >>> logits = 2.0 * np.eye(2)[shapes] + rng.normal(size=(300, 2))[ids]    # that are one and the same
        >>> model = RatioModel.fit([Touch(0, row) for row in logits], shapes, ids)
        >>> model.status, bool(model.correlation > 0.9)
        ('ok', True)
    """

    name: ClassVar[str] = "ratio"

    shape_labels: tuple[str, ...]
    calibration: Calibration
    training_prior: Floats
    correlation: float
    references: Floats
    status: Status = "ok"

    def __post_init__(self) -> None:
        prior = np.asarray(self.training_prior, np.float64)
        num_shapes = len(self.shape_labels)
        if prior.shape != (num_shapes,) or not (prior > 0.0).all() or abs(prior.sum() - 1.0) > 2e-3:
            raise ValueError(f"training_prior must be {num_shapes} positive shares that sum to one, got {prior}")
        if not 0.0 <= self.correlation < 1.0:
            raise ValueError(f"correlation must be in [0, 1), got {self.correlation}")
        references = np.asarray(self.references, np.float64)
        if references.ndim != 3 or references.shape[2] != num_shapes or references.size == 0:
            raise ValueError(f"references must be (P, N, {num_shapes}), none of them empty, got {references.shape}")
        if not np.isfinite(references).all():
            raise ValueError("references must be finite logits")
        object.__setattr__(self, "training_prior", prior / prior.sum())
        object.__setattr__(self, "references", references)

    @classmethod
    def fit(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike | None = None,
        *,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
        calibration: Calibration | None = None,
        num_folds: int = 5,
    ) -> RatioModel:
        """Fit the calibration on all touches, and ρ on posteriors of objects that their calibration did not see.

        Args:
            touches: calibration touches, of objects the classifier was not trained on; touch some of them several
                times in one pose, or ρ can only be assumed (see ``status``).
            shapes: true shape index of each, ``(n,)``.
            object_ids: which object was touched, ``(n,)``; every touch of another one by default.
            shape_labels: names; by default ``shape_0`` and so on.
            num_poses: P; by default one more than the largest pose seen.
            calibration: which kind; structured matrix scaling by default.
            num_folds: in which ρ is cross-fitted.

        Raises:
            ValueError: no touches, labels out of range, or lengths that do not fit.
        """
        batch, truth, objects = calibration_arrays(touches, shapes, object_ids)
        logits, poses = batch.logits[0], batch.poses[0]
        num_shapes = logits.shape[1]
        labels = labels_or_default(shape_labels, num_shapes)
        unfitted = calibration if calibration is not None else StructuredMatrixScaling()
        # A shape without touches counts as half a touch: its prior must not be zero.
        prior = np.maximum(np.bincount(truth, minlength=num_shapes), 0.5)
        prior = prior / prior.sum()
        found = repeats(truth, objects, poses)
        log_ratio = np.empty_like(logits)
        if found is not None:
            folds = object_folds(truth, objects, min(num_folds, int(objects.max()) + 1))
            for fold in range(int(folds.max()) + 1):
                kept, held = folds != fold, folds == fold
                fitted = unfitted.fit(logits[kept], truth[kept]) if kept.any() else unfitted
                log_ratio[held] = fitted.predict_log_proba(logits[held]) - np.log(prior)

        def log_likelihoods(correlation: float) -> Floats:
            assert found is not None, "there is nothing to compare otherwise"
            inside = (found.rows >= 0)[..., None]
            sums = np.where(inside, log_ratio[found.rows], 0.0).cumsum(axis=1)
            number = np.arange(1, sums.shape[1] + 1)
            return (sums * (effective_touches(number, correlation) / number)[:, None])[:, 1:]

        correlation, is_known = fit_correlation(log_likelihoods, found)
        total_poses = int(poses.max()) + 1 if num_poses is None else num_poses
        if poses.max() >= total_poses:
            raise ValueError(f"touch {poses.argmax()} has pose {poses.max()}, num_poses is {total_poses}")
        return cls(
            labels,
            unfitted.fit(logits, truth),
            prior,
            correlation,
            _references(logits, poses, total_poses),
            "ok" if is_known else "no_repeats",
        )

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.references)

    def log_likelihood_batch(self, batch: TouchBatch) -> Floats:
        """See :class:`ArrayModel`."""
        log_ratio = self.calibration.predict_log_proba(batch.logits) - np.log(self.training_prior)
        membership = batch.poses[..., None] == np.arange(self.num_poses)  # (S, n, P)
        counts = membership.sum(axis=1)
        weight = effective_touches(counts, self.correlation) / np.maximum(counts, 1)  # (S, P)
        return np.einsum("sn,snk->sk", np.take_along_axis(weight, batch.poses, axis=1), log_ratio)

    def sample_batch(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`; references, drawn in proportion to what they say for the shape.

        They are drawn independently of each other: how touches repeat is in ``correlation`` as a discount on evidence,
        not as a density that could be sampled.
        """
        cumulative = self._weights()[:, :, shape].cumsum(axis=1)  # (P, N)
        drawn = np.empty(poses.shape, np.int64)
        for pose in np.unique(poses).tolist():
            here = poses == pose
            drawn[here] = np.searchsorted(cumulative[pose], rng.random(here.sum()) * cumulative[pose, -1], "right")
        return TouchBatch(poses, self.references[poses, np.minimum(drawn, self.references.shape[1] - 1)])

    def outcome_table(self, num_outcomes: int | None = None, rng: np.random.Generator | None = None) -> OutcomeTable:
        """See :class:`ArrayModel`; the references, clustered by what they tell, each pose's shrunk towards all."""
        wanted = DEFAULT_OUTCOMES if num_outcomes is None else num_outcomes
        if wanted < 1:
            raise ValueError(f"a table needs at least one outcome, got num_outcomes = {num_outcomes}")
        log_posteriors = self.calibration.predict_log_proba(self.references) - np.log(self.training_prior)
        log_posteriors -= np.logaddexp.reduce(log_posteriors, axis=-1, keepdims=True)
        rng = rng if rng is not None else np.random.default_rng(0)
        outcomes = nearest(log_posteriors, cluster(log_posteriors.reshape(-1, log_posteriors.shape[-1]), wanted, rng))
        weights = self._weights()
        table = np.zeros((self.num_poses, weights.shape[2], wanted))
        pose = np.arange(self.num_poses)[:, None]
        np.add.at(table.transpose(0, 2, 1), (pose, outcomes), weights)
        number = self.references.shape[1] * self.training_prior[:, None]  # touches of each shape in a pose
        pooled = number * table.sum(axis=0) + _SMOOTHING
        pooled /= pooled.sum(axis=1, keepdims=True)
        return OutcomeTable((number * table + _POOLING * pooled) / (number + _POOLING))

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        return {
            "calibration": {"name": self.calibration.name, **self.calibration.to_fields()},
            "training_prior": self.training_prior.tolist(),
            "correlation": self.correlation,
            "status": self.status,
            # In single precision, as they were chosen; written with as few digits as tell them apart.
            "references": [
                [[float(str(z)) for z in row] for row in pose] for pose in self.references.astype(np.float32)
            ],
        }

    @classmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> RatioModel:
        """See :class:`ArrayModel`."""
        kind = fields["calibration"]["name"]
        if kind not in CALIBRATIONS:
            raise ValueError(f"unknown calibration {kind!r}")
        return cls(
            shape_labels,
            CALIBRATIONS[kind].from_fields(fields["calibration"]),
            np.array(fields["training_prior"], np.float64),
            float(fields["correlation"]),
            np.array(fields["references"], np.float32).astype(np.float64),
            fields["status"],
        )

    def _weights(self) -> Floats:
        """Share of each reference in the touches of each shape, ``(P, N, K)``; sums to one over N."""
        probs = self.calibration.predict_proba(self.references)
        return np.asarray(probs / probs.sum(axis=1, keepdims=True))


def _references(logits: Floats, poses: NDArray[np.int64], num_poses: int) -> Floats:
    """As many touches of each pose, evenly spread over those there are, in single precision; all for an unseen pose."""
    rows = []
    for pose in range(num_poses):
        here = np.flatnonzero(poses == pose)
        here = here if here.size else np.arange(len(poses))
        rows.append(here[np.linspace(0, len(here) - 1, _REFERENCES).round().astype(int)])
    with np.errstate(over="ignore"):
        single = logits[np.stack(rows)].astype(np.float32).astype(np.float64)
    return np.where(np.isfinite(single), single, logits[np.stack(rows)])
