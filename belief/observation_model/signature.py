r"""Outcomes that repeat: a hidden signature for every object and pose.

An object touched in a pose has a signature, an outcome drawn from the table. Each touch shows the signature with
probability ρ, and otherwise an outcome drawn anew:

    p(o_1 … o_n | k, pose) = ∑_m T_km ∏_t (ρ [o_t = m] + (1 - ρ) T_k,o_t)

The chance of a single touch is the table's whatever ρ; at ρ = 0 touches are independent, and as ρ → 1 all touches after
the first tell nothing. The sum is over M outcomes and depends on how often each occurred only, so it takes any number
of touches, in closed form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.batch import TouchBatch
from belief.observation_model.confusion import ConfusionModel
from belief.observation_model.model import ArrayModel, calibration_arrays
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.repeats import fit_correlation, repeats
from belief.problem import Floats, Touch

Status: TypeAlias = Literal["ok", "no_repeats"]


@dataclass(frozen=True, eq=False)
class SignatureModel(ArrayModel):
    """A confusion model whose touches in one pose repeat each other.

    Attributes:
        confusion: the model of single touches.
        repeat_probability: ρ, in [0, 1).
        status: ``ok``; ``no_repeats``: no object was touched twice in a pose, and ρ is assumed.

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
    ) -> SignatureModel:
        """The confusion model of these touches, and the ρ that explains how objects' touches repeat.

        Arguments and errors are those of :meth:`ConfusionModel.fit`; ``object_ids`` counts here.
        """
        batch, truth, objects = calibration_arrays(touches, shapes, object_ids)
        confusion = ConfusionModel.fit(
            touches, truth, shape_labels=shape_labels, num_poses=num_poses, confidence_edges=confidence_edges
        )
        found = repeats(truth, objects, batch.poses[0])

        def log_likelihoods(correlation: float) -> Floats:
            assert found is not None, "there is nothing to compare otherwise"
            found_likelihoods = np.empty((*counts.shape[:2], len(confusion.shape_labels)))
            for pose, probs in enumerate(confusion.probs):
                found_likelihoods[poses == pose] = _log_repeats(counts[poses == pose], probs, correlation)
            return found_likelihoods

        if found is not None:
            poses, outcomes = batch.poses[0, found.rows[:, 0]], confusion.outcomes_of(batch.logits[0])
            shown = outcomes[found.rows][..., None] == np.arange(confusion.probs.shape[2])
            counts = (shown & (found.rows >= 0)[..., None]).cumsum(axis=1)[:, 1:]  # (G, n - 1, M)
        correlation, is_known = fit_correlation(log_likelihoods, found)
        return cls(confusion, correlation, "ok" if is_known else "no_repeats")

    @property
    def shape_labels(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the K shapes."""
        return self.confusion.shape_labels

    @property
    def num_poses(self) -> int:
        """P."""
        return self.confusion.num_poses

    def log_likelihood_batch(self, batch: TouchBatch) -> Floats:
        """See :class:`ArrayModel`."""
        outcomes, probs = self.confusion.outcomes_of(batch.logits), self.confusion.probs
        total = np.zeros((len(batch), len(self.shape_labels)))
        for pose in np.unique(batch.poses).tolist():
            shown = (outcomes[..., None] == np.arange(probs.shape[2])) & (batch.poses == pose)[..., None]
            total += _log_repeats(shown.sum(axis=1), probs[pose], self.repeat_probability)
        return total

    def sample_batch(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`."""
        every = np.broadcast_to(np.arange(self.num_poses), (len(poses), self.num_poses))
        signatures = self.confusion.sample_batch(shape, every, rng).logits[np.arange(len(poses))[:, None], poses]
        anew = self.confusion.sample_batch(shape, poses, rng).logits
        shows = rng.random(poses.shape) < self.repeat_probability
        return TouchBatch(poses, np.where(shows[..., None], signatures, anew))

    def outcome_table(self, num_outcomes: int | None = None, rng: np.random.Generator | None = None) -> OutcomeTable:
        """See :class:`ArrayModel`; that of single touches."""
        return self.confusion.outcome_table(num_outcomes, rng)

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


def _log_repeats(counts: NDArray[np.int64], probs: Floats, rho: float) -> Floats:
    """Log-likelihoods ``(..., K)`` of how often outcomes occurred in a pose, ``(..., M)``, by its table ``(K, M)``."""
    with np.errstate(divide="ignore"):
        log_signature, anew, again = np.log(probs), np.log((1.0 - rho) * probs), np.log(rho + (1.0 - rho) * probs)
    occurred, number = counts[..., None, :] > 0, counts[..., None, :]
    # An outcome that did not occur says nothing, however impossible it is: 0 · -∞ counts as 0.
    impossible = occurred & np.isneginf(anew)
    of_others = np.where(occurred & ~impossible, number * np.where(np.isneginf(anew), 0.0, anew), 0.0)
    of_signature = np.where(occurred, number * np.maximum(again, -np.finfo(float).max), 0.0)
    terms = log_signature + of_others.sum(axis=-1, keepdims=True) - of_others + of_signature
    # For a signature m, no outcome but m itself may be one that is never drawn anew.
    others_impossible = impossible.sum(axis=-1, keepdims=True) > impossible
    return np.asarray(np.logaddexp.reduce(np.where(others_impossible, -np.inf, terms), axis=-1))
