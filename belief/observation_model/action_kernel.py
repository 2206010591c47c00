r"""An observation model for touches that are correlated between poses, or actions, as well as within one.

The logits of its touches are log likelihood ratios log q(k | x) - log π_k of a calibrated reader. A touch i of an
object counts as the fraction

    w_i = 1 / ∑_j κ(pose_i, pose_j)                      (the sum is over all touches of the object, κ = 1 for j = i)

of an independent touch. For n touches in one pose with correlation ρ their sum is n / (1 + (n - 1) ρ), the law of
:mod:`belief.observation_model.repeat_discount`. Between poses, κ grows with the likeness of their errors
(decision 0042).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_softmax, softmax

from belief.codec import OPTIONAL
from belief.conflict import MOST_TOUCHES, ConflictTest, ObjectConflict
from belief.constraints import Count, check
from belief.errors import InvalidArgument
from belief.naming import few
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.evidence import SummarisedEvidence
from belief.observation_model.model import ArrayModel, Reads
from belief.observation_model.outcome_mixture import OutcomeMixture, largest_posterior, misfit, with_nothing_new
from belief.observation_model.outcome_table import OutcomeTable, drawn, smoothed, tabulate
from belief.observation_model.repeat_discount import ASSUMED_CORRELATION
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import Floats, unmasked

Integers: TypeAlias = NDArray[np.int64]

_REFERENCES = 500  # touches stored per pose
_ROUNDING = 1e-9  # of correlations
_ORDERS = 4  # random orders of the poses of an object
_LONGEST = 12  # touches of a sequence
_MOST_VALUES = 4_000_000  # logits of all sequences together
_TESTED_ON = 100, 20  # sequences of the conflict test, if there are as many, and at least
_MOST_TESTED = 1200
_MISS = 10.0  # novelty of no contact
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
        kernel: κ, correlation of two touches of an object by their poses, ``(P, P)``, symmetric, in [0, 1], with
            κ(p, p) ≥ κ(p, q).
        references: log likelihood ratios of N representative touches per pose, ``(P, N, K)``.
        repeats: number of different touches of an object in a pose; further ones repeat a recording and count for
            nothing. None if every touch is a new one.
        conflict: conflict test, or None; with it, the features of a touch are its novelty, ``(1,)``.
    """

    name: ClassVar[str] = "action kernel"
    reads: ClassVar[Reads] = "log ratios"

    shape_labels: tuple[str, ...]
    kernel: Floats
    references: Floats
    repeats: Count | None = None
    conflict: Annotated[ConflictTest | None, OPTIONAL] = None

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
        check(self)
        self.freeze()

    @classmethod
    def fit_to(
        cls,
        data: LabelledTouches,
        *,
        sessions: ArrayLike | None = None,
        repeats: int | None = None,
        is_tested: bool = False,
    ) -> ActionKernelModel:
        """Fit the kernel to sequences of touches of objects outside the reader's training set.

        ``sessions (n,)``, any labels that can be sorted, are recording sessions: the first touches of an object in its
        poses come from one, the second ones from another; by default they are numbered. ``is_tested`` adds a conflict
        test, for touches whose features are their novelty.
        """
        numbers = None
        if sessions is not None:
            labels = unmasked(sessions, "sessions")
            if labels.shape != data.poses.shape:
                raise InvalidArgument(f"need a session for each of {len(data.poses)} touches, got {labels.shape}")
            numbers = np.unique(labels, return_inverse=True)[1].astype(np.int64)
        kernel = fit_kernel(data, numbers)
        model = cls(data.shape_labels, kernel, data.logits[data.rows_of_poses(_REFERENCES)], repeats)
        return replace(model, conflict=_fitted_conflict_test(model, data)) if is_tested else model

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.kernel)

    @property
    def repeat_correlation(self) -> float | None:
        """See :class:`ArrayModel`; the mean over poses."""
        return float(np.diagonal(self.kernel).mean())

    def among(self, labels: Sequence[str], poses: Sequence[int] | None = None) -> ActionKernelModel:
        """The model for some of the shapes, and of the poses, numbered anew; its touches have only logits."""
        if isinstance(labels, str) or not len(labels):
            raise InvalidArgument(f"labels must be a list of one or more of {few(self.shape_labels)}, got {labels!r}")
        if unknown := [label for label in labels if label not in self.shape_labels]:
            raise InvalidArgument(f"the model does not know {unknown}, it knows {', '.join(self.shape_labels)}")
        columns = [self.shape_labels.index(label) for label in labels]
        rows = np.arange(self.num_poses) if poses is None else np.array(poses)
        references = self.references[rows][:, :, columns]
        return ActionKernelModel(
            tuple(labels), self.kernel[np.ix_(rows, rows)], references, self.repeats, self.conflict
        )

    def missed(self, pose: int) -> Touch:
        """The touch that stands for a miss: no evidence about the shape, but unusual in the conflict test."""
        return Touch(pose, features=np.array([_MISS]))

    def start(self) -> KernelEvidence:
        """See :class:`ArrayModel`."""
        return KernelEvidence(self, conflict=None if self.conflict is None else self.conflict.start())

    def statistics_with(self, statistics: _Sums | None, touch: Touch) -> _Sums:
        """The touches in each pose that count, and the sums of their log likelihood ratios."""
        batch = self.alone(touch)
        counts, sums = statistics or _Sums(np.zeros(self.num_poses), np.zeros((self.num_poses, len(self.shape_labels))))
        if self.repeats is None or counts[touch.pose] < self.repeats:
            counts, sums = counts.copy(), sums.copy()
            counts[touch.pose] += 1.0
            sums[touch.pose] += _limited(batch.require_logits()[0, 0])
        return _Sums(counts, sums)

    def log_likelihood_of(self, statistics: _Sums) -> Floats:
        """The weighted sum over poses."""
        return np.asarray(touch_weights(statistics.counts, self.kernel) @ statistics.sums)

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

    @cached_property
    def _weights(self) -> Floats:
        """Weight of each reference for each shape, ``(P, N, K)``; sums to one over N."""
        ratios = np.exp(self.references - np.logaddexp.reduce(self.references, axis=-1, keepdims=True))
        ratios = np.maximum(ratios, np.finfo(np.float64).tiny)
        return np.asarray(ratios / ratios.sum(axis=1, keepdims=True))


class _Sums(NamedTuple):
    """Touches in each pose that count, ``(P,)``, and the sums of their log likelihood ratios, ``(P, K)``."""

    counts: Floats
    sums: Floats


@dataclass(frozen=True, eq=False)
class KernelEvidence(SummarisedEvidence):
    """Evidence about one object, from which the information of the next touch in each pose follows.

    >>> model = ActionKernelModel(("cube", "cone"), np.full((2, 2), 0.5), np.zeros((2, 1, 2)))
    >>> twice = model.start().update(Touch(0, np.array([3.0, 0.0]))).update(Touch(1, np.array([3.0, 0.0])))
    >>> twice.log_likelihood.tolist(), twice.outcome_mixture(2, 1).table.probs.shape
    ([4.0, 0.0], (2, 2, 3))
    """

    model: ActionKernelModel
    conflict: ObjectConflict | None = None

    @property
    def log_bets(self) -> Floats | None:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return None if self.conflict is None else self.conflict.log_bets

    def update(self, touch: Touch) -> KernelEvidence:
        """See :class:`SummarisedEvidence`; a touch without logits is a miss, which only the conflict test counts."""
        found, conflict, ratios = self, self.conflict, np.zeros(len(self.model.shape_labels))
        if touch.logits is not None:
            found, ratios = super().update(touch), _limited(touch.logits)
        if conflict is not None and touch.features is not None:
            before = self.log_likelihood
            surprise = float(misfit(ratios[:, None], before, before + ratios))
            conflict = conflict.update(touch.features, surprise, float(largest_posterior(before)))
        return replace(found, conflict=conflict)

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> OutcomeMixture:
        """Outcomes of the next touch, of weight w: with probability w those of a first touch, otherwise "nothing new".

        "Nothing new" is the last outcome, so that the touch has w times the information of a first one.
        """
        counts = self.statistics.counts if self.num_touches else np.zeros(self.model.num_poses)
        weights = 1.0 / (1.0 + counts @ self.model.kernel)
        if self.model.repeats is not None:
            weights = np.where(counts < self.model.repeats, weights, 0.0)
        table = self.model.outcome_table(num_outcomes).probs
        return OutcomeMixture(np.ones((table.shape[1], 1)), with_nothing_new(table, weights)[:, :, None])


def _fitted_conflict_test(model: ActionKernelModel, data: LabelledTouches) -> ConflictTest | None:
    """The conflict test from sequences of touches of one object each, in random order; None for too few.

    Sequences are as long as their number allows. Later touches have the distributions of their last touch.
    """
    order = np.random.default_rng(1).permutation(len(data.poses))
    order = order[np.argsort(data.objects[order], kind="stable")]
    counts = np.bincount(data.objects)
    fit = [n for least in _TESTED_ON for n in range(MOST_TOUCHES, 1, -1) if (counts // n).sum() >= least]
    if not fit:
        return None
    pieces = [own[: len(own) // fit[0] * fit[0]] for own in np.split(order, counts.cumsum()[:-1])]
    rows = np.concatenate(pieces).reshape(-1, fit[0])
    touches = data.batch.take((0, rows[np.sort(np.random.default_rng(2).permutation(len(rows))[:_MOST_TESTED])]))
    assert touches.features is not None, "novelties"
    misfits, certainties = np.zeros(touches.poses.shape), np.zeros(touches.poses.shape)
    for row, sequence in enumerate(touches.sequence(i) for i in range(len(touches))):
        found = model.start()
        for step, touch in enumerate(sequence):
            before, ratios = found.log_likelihood, _limited(touch.require_logits())
            misfits[row, step] = misfit(ratios[:, None], before, before + ratios)
            certainties[row, step] = largest_posterior(before)
            found = found.update(touch)
    test = ConflictTest.fit(touches.features.astype(np.float64), misfits, np.zeros(len(touches), np.int64), certainties)
    return None if test is None else test.longer(MOST_TOUCHES)


def _limited(ratios: Floats) -> Floats:
    return np.clip(ratios, -_LARGEST, _LARGEST)


def numbered_sessions(objects: Integers, poses: Integers) -> Integers:
    """Running number of each touch among those of its object and pose, ``(n,)``."""
    order = np.lexsort((poses, objects))  # stable
    key = np.stack([objects, poses])[:, order]
    is_first = np.append(True, (key[:, 1:] != key[:, :-1]).any(axis=0))[: len(order)]
    rows, numbers = np.arange(len(order)), np.empty(len(order), np.int64)
    numbers[order] = rows - np.maximum.accumulate(np.where(is_first, rows, 0))
    return numbers


def sequences(data: LabelledTouches, sessions: Integers | None, rng: np.random.Generator) -> Integers:
    """Rows of random sequences of the touches of each object, as a search makes them, ``(S, n)``; -1 for padding.

    The n-th touch in a pose comes from the n-th session of the object, with the sessions in random order.
    """
    of_touch = numbered_sessions(data.objects, data.poses) if sessions is None else sessions
    found: list[Integers] = []
    for number in range(data.num_objects):
        rows = np.flatnonzero(data.objects == number)
        for _ in range(_ORDERS):
            known, session = np.unique(of_touch[rows], return_inverse=True)
            turns = np.argsort(rng.permutation(known))[session]
            key = np.empty(len(rows))
            for pose in np.unique(data.poses[rows]).tolist():
                here = np.flatnonzero(data.poses[rows] == pose)
                here = here[np.argsort(turns[here], kind="stable")]
                key[here] = np.sort(rng.random(len(here)))
            found.append(rows[np.argsort(key)][:_LONGEST])
    keep = max(1, _MOST_VALUES // (_LONGEST * data.num_shapes))
    if len(found) > keep:
        found = [found[i] for i in np.sort(rng.choice(len(found), keep, replace=False))]
    padded = np.full((len(found), max(map(len, found))), -1)
    for place, row in enumerate(found):
        padded[place, : len(row)] = row
    return padded


def sequence_losses(logits: Floats, poses: Integers, shapes: Integers, rows: Integers, kernel: Floats) -> Floats:
    """Negative log posterior of the true shape after each touch of every sequence, ``(S, n)``; NaN for padding.

    ``logits (n, K)`` are log likelihood ratios of all touches; ``rows (S, n)`` are the touches of each sequence, with
    -1 for padding; ``kernel`` is ``(P, P)``.
    """
    inside = rows >= 0
    correlation = kernel[poses[rows][:, :, None], poses[rows][:, None, :]] * inside[:, :, None] * inside[:, None, :]
    steps = np.arange(rows.shape[1])
    correlation[:, steps, steps] = 1.0
    totals = correlation.cumsum(axis=2)  # (S, touch, number of touches so far)
    weights = np.tril((inside[:, :, None] / np.maximum(totals, 1.0)).swapaxes(1, 2))
    log_posterior = log_softmax(weights @ logits[rows], axis=2)
    truth = np.broadcast_to(shapes[rows[:, :1], None], (*rows.shape, 1))
    return np.where(inside, -np.take_along_axis(log_posterior, truth, axis=2)[:, :, 0], np.nan)


def likeness(data: LabelledTouches, sessions: Integers | None = None) -> Floats:
    """Likeness of errors (posterior minus truth) in two poses and one session: their cosine, ``(P, P)``, in [0, 1]."""
    errors = softmax(data.logits, axis=1)
    errors[np.arange(len(errors)), data.shapes] -= 1.0
    of_touch = numbered_sessions(data.objects, data.poses) if sessions is None else sessions
    _, group = np.unique(np.stack([data.objects, of_touch]), axis=1, return_inverse=True)
    size = data.num_poses
    table = np.zeros((int(group.max()) + 1, size, data.num_shapes))
    table[group.ravel(), data.poses] = errors
    norms = (table**2).sum(axis=2)
    both = np.einsum("gpk,gqk->pq", table, table)
    is_there = (norms > 0.0).astype(np.float64)
    scale = np.sqrt((norms.T @ is_there) * (is_there.T @ norms))
    found = np.clip(both / np.maximum(scale, np.finfo(float).tiny), 0.0, 1.0)
    np.fill_diagonal(found, 1.0)
    return np.asarray((found + found.T) / 2)


def fit_kernel(data: LabelledTouches, sessions: Integers | None = None) -> Floats:
    """The kernel ``(P, P)`` that minimises the mean negative log posterior of sequences.

    κ of two touches is a for all pairs, plus b times the likeness of their poses, plus c for touches in one pose, with
    a, b, c ≥ 0, so a repeat is never less correlated than touches in two poses. Where no pose was repeated, κ of
    repeats is at least 0.5. The logits must be of a calibration that was not fitted to these touches: otherwise the
    correlations come out too small.
    """
    size = data.num_poses
    found = sequences(data, sessions, np.random.default_rng(0))
    poses = np.where(found >= 0, data.poses[found], -1)
    has_repeats = any((np.bincount(row[row >= 0], minlength=size) > 1).any() for row in poses)
    terms = np.stack([np.eye(size), np.ones((size, size)), likeness(data, sessions)])

    def kernel(parameters: Floats) -> Floats:
        found = np.minimum(np.tensordot(parameters, terms, axes=1), 1.0)
        if not has_repeats:
            np.fill_diagonal(found, np.maximum(found.diagonal(), ASSUMED_CORRELATION))
        return np.asarray(found)

    def loss(parameters: Floats) -> float:
        return float(np.nanmean(sequence_losses(data.logits, data.poses, data.shapes, found, kernel(parameters))))

    options: Any = {"bounds": [(0.0, 0.999)] * len(terms), "method": "L-BFGS-B", "options": {"maxiter": 25}}
    results = [scipy.optimize.minimize(loss, np.full(len(terms), start), **options) for start in (0.3, 0.02)]
    return kernel(min(results, key=lambda result: result.fun).x)
