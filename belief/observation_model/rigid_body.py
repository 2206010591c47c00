r"""The joint observation model: all touches of an object are of one rigid body in one unknown orientation and size.

    p(k | o_1..n) ∝ p(k) · mean_i ∏_t p(o_t | k, R_i, s_i, pose_t)          i: hypotheses of orientation R and size s

The log likelihood ratio of a touch is f(o) · g(k, R, s): the touch brings its embedding f, the model holds the embedded
hypotheses g of each pose. A learned ratio of this form needs no density over images (Hermans, Begy & Louppe 2020).
Touches in different poses are independent given the body. Repeats in one pose are not quite, because the reader's error
about a body in a pose comes again; n of them count as n / (1 + (n - 1) ρ) touches of their mean. Where an object is
touched in very many poses, the reader's error about the object adds up, too; n touches count as n / (1 + (n - 1) κ).

Two shapes, one pose, two hypotheses of each shape; then a touch that fits the first hypothesis of the mug:

>>> embed = FixedHypotheses(np.array([[[[3.0, 0.0], [0.0, 3.0]], [[-3.0, 0.0], [0.0, -3.0]]]], np.float32))
>>> references = np.array([[[1.0, 0.2], [-1.0, 0.1]]])
>>> fitted = FittedRigidBody(("mug", "cup"), 2, 1.0, references, reference_logits=np.zeros((1, 2, 2)))
>>> model: RigidBodyModel = fitted.with_hypotheses(embed)
>>> evidence = model.start().update(Touch(0, features=np.array([1.0, 0.2])))
>>> (evidence.log_likelihood - evidence.log_likelihood.max()).round(1).tolist()
[0.0, -3.6]
>>> evidence.diagnostics.most_likely.tolist()
[0, 1]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.codec import OPTIONAL, Stored, from_fields, to_fields
from belief.conflict import ConflictTest
from belief.frozen import frozen
from belief.observation_model.embedded_hypotheses import (
    EmbeddedHypotheses,
    EmbedsByPose,
    FixedHypotheses,
    ReferenceOutcomes,
    require_table,
)
from belief.observation_model.model import ArrayModel, Embeds, ObservationModel, Reads
from belief.observation_model.outcome_mixture import Views, log_means
from belief.observation_model.outcome_table import OutcomeTable, smoothed, tabulate
from belief.observation_model.repeat_discount import repeat_shares
from belief.observation_model.rigid_body_evidence import Floats32, RigidBodyEvidence, innermost
from belief.problem import Touch
from belief.validation import Floats, require_count, require_number

if TYPE_CHECKING:
    from belief.observation_model.calibration_data import LabelledTouches
    from belief.touch_batch import TouchBatch

_AT_ONCE = 1 << 22  # numbers, of log weights of sequences that are worked on at a time
_REFERENCES = 256  # touches kept of each pose
_SHARED_REFERENCES = 512  # touches kept of each group of poses
_RECOMPUTED = ("_embedded", "outcomes")  # after pickling
_NO_HYPOTHESES = "the model was read from a file and has no hypotheses yet; call with_hypotheses(embed)"


@dataclass(frozen=True, eq=False)
class FittedRigidBody(ArrayModel):
    """The fitted part of the joint model, as in its file: all but the hypotheses, which :meth:`with_hypotheses` adds.

    Planners tabulate it. Likelihoods and samples need the hypotheses: they raise ValueError.

    Attributes:
        shape_labels: names of the K shapes.
        num_hypotheses: number N of hypotheses of each shape.
        temperature: divisor of the log ratios, fitted to sequences of touches.
        references: embeddings of M representative touches of each pose or group of poses, ``(G, M, D)``; used only to
            sample and to tabulate.
        reference_logits: shape logits of the references, ``(G, M, K)``.
        correlation: ρ in [0, 1] of repeats in one pose.
        conflict: test that touches come from the world that the model was fitted to; None without.
        groups: of the poses that share references
            (:class:`~belief.observation_model.outcome_mixture.Views`), one number for each pose; empty if every pose
            has its own.
        drift: κ in [0, 1], correlation of the reader's errors about one object in different poses.

    Raises:
        ValueError: arrays that do not fit each other or are not finite real numbers, labels that are not different
            names, or a number out of range.
    """

    name: ClassVar[str] = "rigid body"
    reads: ClassVar[Reads] = "embeddings"
    last_in_file: ClassVar = ("references", "reference_logits", "conflict", "groups", "drift")
    shape_labels: tuple[str, ...]
    num_hypotheses: int
    temperature: float
    references: Annotated[Floats, Stored("float16")]
    reference_logits: Annotated[Floats, Stored("float16")]
    correlation: float = 0.0
    conflict: ConflictTest | None = None
    groups: Annotated[tuple[int, ...], OPTIONAL] = ()
    drift: Annotated[float, OPTIONAL] = 0.0

    def __post_init__(self) -> None:
        self.to_floats("references", "reference_logits")
        if self.references.ndim != 3 or self.references.size == 0:
            raise ValueError(f"references must be (G, M, D), none of them empty, got {self.references.shape}")
        num_groups, number, _ = self.references.shape
        require_count("num_hypotheses", self.num_hypotheses)
        if self.groups and sorted(set(self.groups)) != list(range(num_groups)):
            raise ValueError(f"there are references of {num_groups} groups of poses, the poses are of {self.groups}")
        if self.reference_logits.shape != (num_groups, number, len(self.shape_labels)):
            raise ValueError(f"reference_logits must fit the references, got {self.reference_logits.shape}")
        if not 0.0 < self.temperature < np.inf:
            raise ValueError(f"temperature must be positive and finite, got {self.temperature}")
        require_number("correlation", self.correlation, 0.0, 1.0)
        require_number("drift", self.drift, 0.0, 1.0)
        self.freeze()

    def with_hypotheses(self, embed: Embeds, num_hypotheses: int | None = None) -> RigidBodyModel:
        """The model with these hypotheses, which are embedded at first use.

        Args:
            embed: embeds hypotheses.
            num_hypotheses: number N of hypotheses of each shape; that of the fit by default. With another number the
                model has no conflict test.
        """
        fitted = {field.name: getattr(self, field.name) for field in fields(FittedRigidBody)}
        if num_hypotheses not in (None, self.num_hypotheses):
            fitted |= {"num_hypotheses": num_hypotheses, "conflict": None}
        return RigidBodyModel(**fitted, hypotheses=embed)

    @property
    def num_poses(self) -> int:
        """See :class:`ArrayModel`."""
        return len(self.groups or self.references)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        raise ValueError(_NO_HYPOTHESES)

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        raise ValueError(_NO_HYPOTHESES)

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`: single touches, clustered by what they tell about the shape."""
        log_posteriors = self.reference_logits - scipy.special.logsumexp(self.reference_logits, axis=2, keepdims=True)
        shares = np.exp(log_posteriors)
        shares /= shares.sum(axis=1, keepdims=True)
        found = smoothed(tabulate(log_posteriors, shares, num_outcomes, rng), self.references.shape[1])
        return OutcomeTable(found[list(self.groups)] if self.groups else found)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`; without the hypotheses, which the reader embeds."""
        return to_fields(self, FittedRigidBody)

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> FittedRigidBody:
        """See :class:`ArrayModel`; :meth:`with_hypotheses` completes it."""
        return from_fields(FittedRigidBody, fields, is_whole=False)


@dataclass(frozen=True, eq=False)
class RigidBodyModel(FittedRigidBody):
    """Joint posterior over shape, orientation and size, from a learned likelihood ratio.

    Attributes:
        hypotheses: embeds the hypotheses g of every pose, at first use; by pose where poses share references.

    Other attributes and errors are those of :class:`FittedRigidBody`. :class:`FixedHypotheses` that do not fit raise
    ValueError, too.
    """

    hypotheses: Embeds = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.groups and not isinstance(self.hypotheses, EmbedsByPose):
            raise ValueError(f"the groups {self.groups} need hypotheses embedded by pose, got {self.hypotheses!r:.80}")
        if isinstance(self.hypotheses, FixedHypotheses):
            require_table(self.hypotheses.table, self._table_shape)

    @classmethod
    def fit_to(cls, data: LabelledTouches, *, embed: Embeds, num_hypotheses: int = 2048) -> RigidBodyModel:
        """Fit temperature, correlation of repeats and conflict test; keep some touches as references.

        Args:
            data: touches with embeddings as features, of objects that the reader was not trained on.
            embed: embeds hypotheses.
            num_hypotheses: number N of hypotheses of each shape; more are more accurate and slower.

        Raises:
            ValueError: the touches bring no embeddings, or do not fit the hypotheses.
        """
        if data.batch.features is None:
            raise ValueError("the touches bring no embeddings: Touch(pose, logits, features=reading.embeddings[i])")
        found = np.asarray(data.batch.features[0], np.float64)
        groups = embed.groups if isinstance(embed, EmbedsByPose) else ()
        rows = data.rows_of_poses(_SHARED_REFERENCES if groups else _REFERENCES, groups)
        kept = (_in_half(found[rows]), _in_half(data.logits[rows]))
        hypotheses = embed if groups else FixedHypotheses(embed(num_hypotheses))
        model = cls(data.shape_labels, num_hypotheses, 1.0, *kept, groups=groups, hypotheses=hypotheses)
        from belief.observation_model.rigid_body_fit import fitted

        model, conflict = fitted(model, data)
        return replace(model, conflict=conflict)

    def at(self, temperature: float, correlation: float | None = None, drift: float | None = None) -> RigidBodyModel:
        """The model at another temperature, and at another correlation of repeats or drift if one is given.

        It has no conflict test, which holds at one temperature only.
        """
        correlation = self.correlation if correlation is None else correlation
        drift = self.drift if drift is None else drift
        return replace(self, temperature=temperature, correlation=correlation, drift=drift, conflict=None)

    def embeddings(self, batch: TouchBatch) -> Floats:
        """Embeddings of a batch of touches, ``(S, n, D)``.

        Raises:
            ValueError: the touches bring none, or some of another size.
        """
        wanted = self.references.shape[-1]
        if batch.features is None or batch.features.shape[-1] != wanted:
            found = "none" if batch.features is None else f"{batch.features.shape[-1]} numbers"
            raise ValueError(f"a touch must bring its embedding of {wanted} numbers as its features, got {found}")
        return np.asarray(batch.features)

    def embedding_of(self, touch: Touch) -> Floats:
        """The embedding that a touch brings, ``(1, D)``.

        Raises:
            ValueError: the touch does not fit the model, or brings none.
        """
        found, logits = touch.features, touch.logits
        if found is not None and found.shape == self.references.shape[-1:] and touch.pose < self.num_poses:
            plain = logits is None or (logits.shape == (len(self.shape_labels),) and np.isfinite(logits).all())
            if plain and np.isfinite(found).all():
                return np.asarray(found[None])
        return self.embeddings(self.alone(touch))[0]  # says what is wrong

    @property
    def views(self) -> Views | None:
        """Which hypotheses look alike in different poses; None if every pose has references of its own."""
        return self._embedded.views

    @property
    def table(self) -> Floats32:
        """The embedded hypotheses of every pose, ``(P, K, N, D)``, read-only.

        Raises:
            ValueError: they do not fit the references.
        """
        return self._embedded.table

    def scores(self, pose: int, embeddings: Floats, shapes: slice = slice(None)) -> Floats32:
        """Log p(touch | hypothesis), ``(n, K, N)``; see :meth:`EmbeddedHypotheses.scores`."""
        return self._embedded.scores(pose, embeddings, shapes)

    def scores_of(self, touch: Touch, embedding: Floats) -> Floats32:
        """Log p(touch | hypothesis) of one touch, ``(K, N)``, in its pose or wherever else it was made."""
        if touch.elsewhere is None:
            return self.scores(int(touch.pose), embedding)[0]
        found = self._embedded.scores_under(touch.elsewhere.hypotheses, embedding)[0]
        if len(found) != len(self.shape_labels):
            raise ValueError(f"hypotheses must be of {len(self.shape_labels)} shapes, got {len(found)}")
        return found

    def before_next(self, log_weights: NDArray[Any]) -> NDArray[Any]:
        """Log weights ``(..., N)`` just before the next touch of a body, from those after the last one."""
        return log_weights

    @cached_property
    def outcomes(self) -> ReferenceOutcomes:
        """The reference touches, and the probability of each under a hypothesis."""
        return ReferenceOutcomes(self._embedded, self.references, self.reference_logits)

    @cached_property
    def _embedded(self) -> EmbeddedHypotheses:
        return EmbeddedHypotheses(self.hypotheses, self._table_shape, self.groups, self.temperature)

    @property
    def _table_shape(self) -> tuple[int, int, int, int]:
        return self.num_poses, len(self.shape_labels), self.num_hypotheses, self.references.shape[-1]

    def __getstate__(self) -> dict[str, Any]:
        """The state for another process, with the embedded table unless poses share references: it is large then."""
        state = {name: value for name, value in vars(self).items() if name not in _RECOMPUTED}
        return state if self.groups else {**state, "hypotheses": FixedHypotheses(self.table)}

    def start(self) -> RigidBodyEvidence:
        """See :class:`ArrayModel`."""
        return self._start

    @cached_property
    def _start(self) -> RigidBodyEvidence:
        """The evidence without touches, shared by all objects, so that its properties are computed once."""
        conflict = None if self.conflict is None else self.conflict.start()
        zeros = np.zeros((len(self.shape_labels), self.num_hypotheses))
        return RigidBodyEvidence(self, frozen(zeros), frozen(zeros[:, 0]), tested=conflict)

    def log_weights(
        self, batch: TouchBatch, dtype: type[np.floating] = np.float64, shapes: slice = slice(None)
    ) -> NDArray[Any]:
        """Log weight of every hypothesis after all touches of each sequence, up to a constant, ``(S, K, N)``.

        Args:
            batch: the touches.
            dtype: of the sums; single precision takes half the memory.
            shapes: of the hypotheses; all by default.
        """
        embeddings = self.embeddings(batch)
        shares = repeat_shares(batch.poses, self.correlation, self.drift).astype(dtype)
        weights = np.zeros((len(batch), len(self.shape_labels[shapes]), self.num_hypotheses), dtype)
        for step in range(batch.num_touches):
            weights = self.before_next(weights) if step else weights
            for pose in np.unique(batch.poses[:, step]).tolist():
                here = np.flatnonzero(batch.poses[:, step] == pose)
                weights[here] += shares[here, step, None, None] * self.scores(pose, embeddings[here, step], shapes)
        return weights

    def steps(self, batch: TouchBatch) -> Iterator[tuple[Floats, Floats32, Floats]]:
        """The log weights before each step of S sequences, the scores of its touches, and the log weights after it.

        Yields:
            Three arrays ``(S, K, N)``; log weights have largest 0.
        """
        embeddings = self.embeddings(batch)
        before = np.zeros((len(batch), len(self.shape_labels), self.num_hypotheses))
        seen: list[Floats32] = []
        for step in range(batch.num_touches):
            scores = np.empty(before.shape, np.float32)
            for pose in np.unique(batch.poses[:, step]).tolist():
                here = batch.poses[:, step] == pose
                scores[here] = self.scores(pose, embeddings[here, step])
            seen.append(scores)
            shares = repeat_shares(batch.poses[:, : step + 1], self.correlation, self.drift)
            if (shares == 1.0).all():
                after = before + scores
            else:
                weighted = (share[:, None, None] * some for share, some in zip(shares.T, seen, strict=True))
                after = sum(weighted, np.zeros_like(before))
            after = after - after.max(axis=(1, 2), keepdims=True)
            yield before, scores, after
            before = after

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        size = max(1, _AT_ONCE // (len(self.shape_labels) * self.num_hypotheses))
        blocks = [batch.sequences(slice(first, first + size)) for first in range(0, len(batch), size)]
        return np.concatenate([log_means(self.log_weights(block)) for block in blocks])

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`: one hypothesis for each object, then references by their ratio under it."""
        return self.outcomes.sample(shape, poses, rng)


def joint_model(model: ObservationModel) -> RigidBodyModel | None:
    """The model, or its nominal one, if it is about one rigid body of unknown orientation and size; otherwise None."""
    found = innermost(model)
    return found if isinstance(found, RigidBodyModel) else None


def _in_half(array: Floats) -> Floats:
    """The numbers rounded as in a file; those beyond half precision become its largest."""
    largest = float(np.finfo(np.float16).max)
    return np.clip(array, -largest, largest).astype(np.float16).astype(np.float64)
