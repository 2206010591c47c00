r"""The signature model: a confusion model with a hidden outcome per object and pose that touches repeat.

The signature of an object in a pose is an outcome drawn from the table. Each touch gives the signature with probability
ρ, and otherwise a new draw:

    p(o_1 … o_n | k, pose) = ∑_m T_km ∏_t (ρ [o_t = m] + (1 - ρ) T_k,o_t)

A single touch has the probability in the table for any ρ. At ρ = 0 touches are independent; as ρ → 1 touches after the
first give no information. The sum depends only on how often each outcome occurred.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.cross_validation import object_folds
from belief.observation_model.baselines.confusion import ConfusionModel
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.repeat_discount import ASSUMED_CORRELATION, fit_correlation, repeats
from belief.problem import Floats, Touch
from belief.touch_batch import TouchBatch
from belief.validation import require_choice

Status: TypeAlias = Literal["ok", "no_repeats"]


@dataclass(frozen=True, eq=False)
class SignatureModel(ArrayModel):
    """A confusion model whose touches in one pose repeat each other.

    Attributes:
        confusion: model of single touches.
        repeat_probability: ρ, in [0, 1).
        status: ``ok``, or ``no_repeats`` if ρ is assumed because no objects of two shapes were touched twice in a pose.

    Raises:
        ValueError: a probability out of range, or an unknown status.

    Example:
        >>> from belief.calibration import TemperatureScaling
        >>> table = np.array([[[0.8, 0.2], [0.2, 0.8]]])
        >>> single = ConfusionModel(("cube", "cone"), table, TemperatureScaling(1.0, "ok"))
        >>> model = SignatureModel(single, repeat_probability=0.9)
        >>> touch = Touch(0, np.array([2.0, 0.0]))
        >>> [round(float(np.ptp(m.log_likelihood([touch] * 3))), 2) for m in (single, model)]
        [4.16, 1.58]
    """

    name: ClassVar[str] = "signature"

    confusion: ConfusionModel
    repeat_probability: float
    status: Status = "ok"

    def __post_init__(self) -> None:
        if not 0.0 <= self.repeat_probability < 1.0:
            raise ValueError(f"repeat_probability must be in [0, 1), got {self.repeat_probability}")
        require_choice("status", self.status, get_args(Status))

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
        num_folds: int = 5,
    ) -> SignatureModel:
        """Fit the confusion model, and ρ to repeated touches of an object (``object_ids``) in one pose.

        ρ is fitted with confusion models of other objects, in ``num_folds`` folds of whole objects (decision 0074).
        Arguments and errors are otherwise those of :meth:`ConfusionModel.fit`.
        """
        data = LabelledTouches.of(touches, shapes, object_ids, shape_labels, num_poses)

        def counted(rows: NDArray[np.intp]) -> ConfusionModel:
            return ConfusionModel.fit(
                [touches[row] for row in rows.tolist()],
                data.shapes[rows],
                shape_labels=data.shape_labels,
                num_poses=data.num_poses,
                confidence_edges=confidence_edges,
            )

        confusion, found = counted(np.arange(len(data.shapes))), repeats(data)
        if found is None:
            return cls(confusion, ASSUMED_CORRELATION, "no_repeats")
        folds = object_folds(data.shapes, data.objects, min(num_folds, data.num_objects))
        parts = []
        for fold in np.unique(folds[found.rows[:, 0]]).tolist():
            groups = folds[found.rows[:, 0]] == fold
            others = counted(np.flatnonzero(folds != fold))
            parts.append((groups, others, *_outcomes_of_groups(others, data, found.rows[groups])))
        shape = (*found.rows[:, 1:].shape, data.num_shapes)

        def log_likelihoods(rho: float) -> Floats:
            values = np.empty(shape)
            for groups, others, poses, outcomes, counts in parts:
                values[groups] = cls(others, rho)._log_repeats(poses, outcomes, counts)
            return values

        return cls(confusion, fit_correlation(log_likelihoods, found))

    @property
    def shape_labels(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the K shapes."""
        return self.confusion.shape_labels

    @property
    def num_poses(self) -> int:
        """P."""
        return self.confusion.num_poses

    @property
    def repeat_correlation(self) -> float:
        """See :class:`ArrayModel`; ρ² is the probability that two touches both give the signature."""
        return self.repeat_probability**2

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        outcomes, every = self.confusion.outcomes_of(batch.require_logits()), np.arange(self.confusion.probs.shape[2])
        total = np.zeros((len(batch), len(self.shape_labels)))
        for pose in np.unique(batch.poses).tolist():
            counts = ((outcomes[..., None] == every) & (batch.poses == pose)[..., None]).sum(axis=1)  # (S, M)
            total += self._log_repeats(pose, every, counts)
        return total

    def statistics_with(self, statistics: _Occurred | None, touch: Touch) -> _Occurred:
        """Counts of the outcomes in each pose, and their log-likelihoods."""
        batch = self.alone(touch)
        pose, (outcome,) = int(batch.poses[0, 0]), self.confusion.outcomes_of(batch.require_logits()[0]).tolist()
        num_poses, num_shapes, num_outcomes = self.confusion.probs.shape
        if statistics is None:
            counts, log_likelihoods = np.zeros((num_poses, num_outcomes), np.int64), np.zeros((num_poses, num_shapes))
        else:
            counts, log_likelihoods = statistics.counts.copy(), statistics.log_likelihoods.copy()
        counts[pose, outcome] += 1
        log_likelihoods[pose] = self._log_repeats(pose, np.arange(num_outcomes), counts[pose][None])[0]
        return _Occurred(counts, log_likelihoods)

    def log_likelihood_of(self, statistics: _Occurred) -> Floats:
        """The sum of the log-likelihoods over poses."""
        return np.asarray(statistics.log_likelihoods.sum(axis=0))

    def _log_repeats(
        self, poses: NDArray[np.int64] | int, outcomes: NDArray[np.int64], counts: NDArray[np.int64]
    ) -> Floats:
        """Log-likelihoods ``(..., K)`` of outcomes with their counts in one pose.

        Args:
            poses: ``(..., 1)``.
            outcomes: ``(..., m)``, different where their counts are positive.
            counts: ``(..., m)``.
        """
        anew, of_signature = self._logs
        number, occurred = counts[..., None], (counts > 0)[..., None]  # (..., m, 1)
        independent = (number * np.where(occurred, anew[poses, outcomes], 0.0)).sum(axis=-2)
        # The signature is one of the outcomes that occurred, which are then more likely, or another outcome.
        probs = np.where(occurred, self._probs_by_outcome[poses, outcomes], 0.0)
        likelier = np.where(probs > 0.0, number * of_signature[poses, outcomes], 0.0)  # log factors
        most = np.maximum(likelier.max(axis=-2), 0.0)
        shown = (probs * np.exp(likelier - most[..., None, :])).sum(axis=-2)
        others = np.maximum(1.0 - probs.sum(axis=-2), 0.0) * np.exp(-most)
        return np.asarray(independent + most + np.log(shown + others))

    @cached_property
    def _probs_by_outcome(self) -> Floats:
        """``(P, M, K)``."""
        return np.swapaxes(self.confusion.probs, 1, 2)

    @cached_property
    def _logs(self) -> tuple[Floats, Floats]:
        """Log of (1 - ρ) T, and log of the factor by which the signature is more likely; both ``(P, M, K)``."""
        rho, probs = self.repeat_probability, self._probs_by_outcome
        with np.errstate(divide="ignore"):
            anew = np.log1p(-rho) + np.log(probs)
        again = np.log(rho + (1.0 - rho) * probs, where=probs > 0.0, out=np.zeros_like(probs))
        return anew, again - np.where(probs > 0.0, anew, 0.0)

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        every = np.broadcast_to(np.arange(self.num_poses), (len(poses), self.num_poses))
        once = self.confusion.sample_batch(shape, every, rng).require_logits()
        signatures = once[np.arange(len(poses))[:, None], poses]
        anew = self.confusion.sample_batch(shape, poses, rng).require_logits()
        shows = rng.random(poses.shape) < self.repeat_probability
        return TouchBatch(poses, np.where(shows[..., None], signatures, anew))

    @property
    def default_outcomes(self) -> int:
        """M of the confusion model."""
        return self.confusion.default_outcomes

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; the table of single touches."""
        return self.confusion.outcome_table(num_outcomes)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        return {
            "repeat_probability": self.repeat_probability,
            "status": self.status,
            "confusion": self.confusion.to_fields(),
        }

    @classmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> SignatureModel:
        """See :class:`ArrayModel`."""
        confusion = ConfusionModel.from_fields(shape_labels, fields["confusion"])
        return cls(confusion, float(fields["repeat_probability"]), fields["status"])


class _Occurred(NamedTuple):
    """``counts`` of the outcomes in each pose, ``(P, M)``, and their log-likelihoods, ``(P, K)``."""

    counts: NDArray[np.int64]
    log_likelihoods: Floats


def _outcomes_of_groups(
    confusion: ConfusionModel, data: LabelledTouches, rows: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Poses and outcomes of groups of repeats, and how often each had occurred after two, three, … touches.

    Args:
        confusion: tells the outcome of a touch.
        data: all touches.
        rows: of the touches of each group, ``(G, n)``; -1 for padding.

    Returns:
        ``(G, 1, 1)``, ``(G, 1, n)`` and ``(G, n - 1, n)``; an outcome counts at its first occurrence only.
    """
    outcomes = np.where(rows >= 0, confusion.outcomes_of(data.logits)[rows], -1)
    same = outcomes[:, :, None] == outcomes[:, None]  # (G, n, n)
    is_first = same.argmax(axis=2) == np.arange(outcomes.shape[1])  # first occurrence in its group
    counts = np.where(is_first[:, None], same.cumsum(axis=1), 0)[:, 1:]
    return data.poses[rows[:, 0], None, None], outcomes[:, None], counts
