r"""An observation model for touches that are correlated between poses, or actions, as well as within one.

The logits of its touches are log likelihood ratios log q(k | x) - log π_k of a calibrated reader. A touch i of an
object counts as the fraction

    w_i = 1 / ∑_j κ(pose_i, pose_j)                      (the sum is over all touches of the object, κ = 1 for j = i)

of an independent touch. For n touches in one pose with correlation ρ their sum is n / (1 + (n - 1) ρ), the law of
:mod:`belief.observation_model.repeat_discount`. Between poses, κ grows with the likeness of their errors
(decision 0042).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.errors import InvalidArgument
from belief.frozen import frozen
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.kernel_fit import fit_kernel
from belief.observation_model.model import ArrayModel, Reads
from belief.observation_model.outcome_mixture import OutcomeMixture, with_nothing_new
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.quantisation import drawn, smoothed, tabulate
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import Floats, require_choice, require_count, unmasked

Law: TypeAlias = Literal["none", "repeats", "flat", "kernel"]
"""Which touches are correlated: none; those in one pose; all, equally; all, by the likeness of their poses."""

_REFERENCES = 500  # touches stored per pose
_ROUNDING = 1e-9  # of correlations
_LARGEST = 1e290  # log likelihood ratios are limited to it, so that sums of them do not overflow


def touch_weights(counts: ArrayLike, kernel: Floats) -> Floats:
    """Fraction of an independent touch that each touch in a pose counts as, ``(..., P)``, for ``counts (..., P)``."""
    n = np.asarray(counts, np.float64)
    others = n @ kernel - np.where(n > 0.0, 1.0, 0.0) * np.diagonal(kernel)
    return np.asarray(1.0 / (1.0 + np.maximum(others, 0.0)))


@dataclass(frozen=True, eq=False)
class ActionKernelModel(ArrayModel):
    """Log likelihood ratios, weighted by a kernel of correlations between poses.

    Attributes:
        shape_labels: names of the K shapes.
        kernel: κ, correlation of two touches of an object by their poses, ``(P, P)``, symmetric, in [0, 1]; a repeat is
            at least as correlated as touches in two poses, κ(p, p) ≥ κ(p, q).
        references: log likelihood ratios of N representative touches per pose, ``(P, N, K)``.
        repeats: number of different touches of an object in a pose; one more in the pose repeats a recording and counts
            for nothing. None if every touch is a new one.
        law: how the kernel was fitted.
    """

    name: ClassVar[str] = "action kernel"
    reads: ClassVar[Reads] = "log ratios"

    shape_labels: tuple[str, ...]
    kernel: Floats
    references: Floats
    repeats: int | None = None
    law: Law = "kernel"

    def __post_init__(self) -> None:
        self.to_floats("kernel", "references")
        kernel, references = self.kernel, self.references
        num_shapes = len(self.shape_labels)
        if kernel.ndim != 2 or kernel.shape[0] != kernel.shape[1] or not ((kernel >= 0.0) & (kernel <= 1.0)).all():
            raise ValueError(f"kernel must be (P, P) with entries in [0, 1], got {kernel.tolist()}")
        if not np.allclose(kernel, kernel.T):
            raise ValueError(f"kernel must be symmetric, got {kernel.tolist()}")
        if (beyond := kernel - kernel.diagonal()[:, None]).max(initial=0.0) > _ROUNDING:
            p, q = np.unravel_index(beyond.argmax(), beyond.shape)
            raise ValueError(
                f"a repeat must be at least as correlated as touches in two poses, got κ({p}, {p}) = "
                f"{kernel[p, p]:.3g} below κ({p}, {q}) = {kernel[p, q]:.3g}"
            )
        if references.ndim != 3 or references.shape[::2] != (len(kernel), num_shapes) or references.size == 0:
            raise ValueError(f"references must be ({len(kernel)}, N, {num_shapes}), N ≥ 1, got {references.shape}")
        if self.repeats is not None:
            require_count("repeats", self.repeats)
        require_choice("law", self.law, get_args(Law))
        self.freeze()

    @classmethod
    def fit(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike | None = None,
        *,
        sessions: ArrayLike | None = None,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
        repeats: int | None = None,
        law: Law = "kernel",
    ) -> ActionKernelModel:
        """Fit the kernel to sequences of touches of objects outside the reader's training set.

        Args:
            touches: with log likelihood ratios as logits.
            shapes: true shape index of each, ``(n,)``.
            object_ids: object of each, ``(n,)``; by default every touch is of another object.
            sessions: recording session of each, ``(n,)``, any labels that can be sorted: the first touches of an object
                in its poses come from one session, the second ones from another. By default the sessions of an object
                and pose are numbered.
            shape_labels: names of the shapes.
            num_poses: P.
            repeats: see :class:`ActionKernelModel`.
            law: which touches may be correlated.
        """
        require_choice("law", law, get_args(Law))
        data = LabelledTouches.of(touches, shapes, object_ids, shape_labels, num_poses)
        kernel = fit_kernel(data, law, None if sessions is None else _numbered(sessions, len(touches)))
        return cls(data.shape_labels, kernel, data.logits[data.rows_of_poses(_REFERENCES)], repeats, law)

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.kernel)

    @property
    def repeat_correlation(self) -> float | None:
        """See :class:`ArrayModel`; the mean over poses."""
        return float(np.diagonal(self.kernel).mean())

    def among(self, labels: Sequence[str]) -> ActionKernelModel:
        """The model for objects that are known to be of some of the shapes; its touches have their logits only."""
        if unknown := [label for label in labels if label not in self.shape_labels]:
            raise ValueError(f"the model does not know {unknown}, it knows {', '.join(self.shape_labels)}")
        columns = [self.shape_labels.index(label) for label in labels]
        return ActionKernelModel(tuple(labels), self.kernel, self.references[:, :, columns], self.repeats, self.law)

    def start(self) -> KernelEvidence:
        """See :class:`ArrayModel`."""
        shape = self.num_poses, len(self.shape_labels)
        return KernelEvidence(self, np.zeros(self.num_poses), np.zeros(shape))

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        membership = batch.poses[..., None] == np.arange(self.num_poses)  # (S, n, P)
        uses = np.take_along_axis(membership.cumsum(axis=1), batch.poses[..., None], axis=2)[..., 0]
        is_new = uses <= (self.repeats or batch.num_touches)
        counts = (membership & is_new[..., None]).sum(axis=1)
        weights = np.take_along_axis(touch_weights(counts, self.kernel), batch.poses, axis=1) * is_new
        return (weights[:, None] @ _limited(batch.require_logits()))[:, 0]

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`; independent draws of references, weighted by their likelihood of the shape."""
        return TouchBatch(poses, self.references[poses, drawn(self._weights[:, :, shape], poses, rng)])

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        log_posteriors = self.references - np.logaddexp.reduce(self.references, axis=-1, keepdims=True)
        table = tabulate(log_posteriors, self._weights, num_outcomes, rng)
        return OutcomeTable(smoothed(table, self.references.shape[1] / len(self.shape_labels)))

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        return {
            "kernel": self.kernel.tolist(),
            "references": self.references.tolist(),
            "repeats": self.repeats,
            "law": self.law,
        }

    @classmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> ActionKernelModel:
        """See :class:`ArrayModel`."""
        kernel, references = (np.array(fields[name], np.float64) for name in ("kernel", "references"))
        return cls(shape_labels, kernel, references, fields["repeats"], fields["law"])

    @cached_property
    def _weights(self) -> Floats:
        """Weight of each reference for each shape, ``(P, N, K)``; sums to one over N."""
        ratios = np.exp(self.references - np.logaddexp.reduce(self.references, axis=-1, keepdims=True))
        ratios = np.maximum(ratios, np.finfo(np.float64).tiny)
        return np.asarray(ratios / ratios.sum(axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class KernelEvidence:
    """The evidence about one object, see :class:`~belief.observation_model.evidence.ObjectEvidence`.

    Attributes:
        model: weights the touches.
        counts: touches in each pose that count, ``(P,)``.
        sums: of their log likelihood ratios, ``(P, K)``.
        num_touches: all touches.

    >>> model = ActionKernelModel(("cube", "cone"), np.full((2, 2), 0.5), np.zeros((2, 1, 2)))
    >>> twice = model.start().update(Touch(0, np.array([3.0, 0.0]))).update(Touch(1, np.array([3.0, 0.0])))
    >>> twice.log_likelihood.tolist(), twice.outcome_mixture(2, 1).table.probs.shape
    ([4.0, 0.0], (2, 2, 3))
    """

    model: ActionKernelModel
    counts: Floats
    sums: Floats
    num_touches: int = 0

    def update(self, touch: Touch) -> KernelEvidence:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        batch = self.model.alone(touch)
        counts, sums = self.counts, self.sums
        if self.model.repeats is None or counts[touch.pose] < self.model.repeats:
            counts, sums = counts.copy(), sums.copy()
            counts[touch.pose] += 1.0
            sums[touch.pose] += _limited(batch.require_logits()[0, 0])
        return KernelEvidence(self.model, counts, sums, self.num_touches + 1)

    @property
    def log_bets(self) -> None:
        """None: the model has no test of whether it knows the world."""

    @cached_property
    def log_likelihood(self) -> Floats:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return frozen(touch_weights(self.counts, self.model.kernel) @ self.sums)

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> OutcomeMixture:
        """The outcomes of the next touch: those of a first touch with the weight it would have, otherwise nothing new.

        "Nothing new" is the last outcome, so that a touch of weight w has w times the information of a first one.
        """
        weights = 1.0 / (1.0 + self.counts @ self.model.kernel)
        if self.model.repeats is not None:
            weights = np.where(self.counts < self.model.repeats, weights, 0.0)
        table = self.model.outcome_table(num_outcomes).probs
        return OutcomeMixture(np.ones((table.shape[1], 1)), with_nothing_new(table, weights)[:, :, None])


def _numbered(sessions: ArrayLike, num_touches: int) -> NDArray[np.int64]:
    """Sessions as numbers from 0, in ascending order of their labels."""
    labels = unmasked(sessions, "sessions")
    if labels.shape != (num_touches,):
        raise InvalidArgument(f"need a session for each of {num_touches} touches, got {labels.shape}")
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)


def _limited(ratios: Floats) -> Floats:
    return np.clip(ratios, -_LARGEST, _LARGEST)
