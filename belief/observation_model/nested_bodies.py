r"""The joint observation model of one rigid body among very many, whose orientations are weighed coarse to fine.

    p(k | o_1..n) ∝ p(k) · ∑_cells p(cell) ∏_t p(o_t | k, cell, pose_t)

It is the model of :mod:`belief.observation_model.rigid_body` where a table of all hypotheses would be too large: cells
of orientations are divided only where the posterior is (:mod:`belief.coarse_to_fine`). The log likelihood ratio of a
touch is linear in its embedding, so that n touches in one pose count as n / (1 + (n - 1) ρ) touches of their mean.

Outcomes of the next touch are M reference touches. A body that none of the drawn hypotheses stands for is supposed to
give each of them with the same probability.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Protocol

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.cell_kernel import CellKernel
from belief.coarse_to_fine import CellLikelihood, CoarseToFine, Effort, Ints, Leaves, NestedCells
from belief.codec import array_field
from belief.constraints import Probability, Within, check
from belief.frozen import frozen
from belief.observation_model.model import ArrayModel, Reads
from belief.observation_model.outcome_mixture import bounded_softmax, with_nothing_new
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.repeat_discount import ASSUMED_CORRELATION, effective_touches, new_shares
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import Floats

Floats32 = NDArray[np.float32]

_OUTCOMES = 128  # of a table, by default
_PER_SHAPE = 8  # hypotheses for a decision, for each that a decider asks for of a shape
_AT_ONCE = 50  # bodies
_TINY = np.finfo(np.float64).tiny


class BodyLikelihood(CellLikelihood, Protocol):
    """Likelihoods of touches of K bodies in nested cells of orientations."""

    @property
    def num_poses(self) -> int:
        """P."""

    def felt(self, pose: int, embedding: NDArray[np.floating]) -> Any:
        """A touch in a pose, as the other methods take it; likelihoods are linear in the embedding."""

    def log_ratios(
        self, level: Ints, bodies: Ints, cells: Ints, references: Floats32, poses: Sequence[int] | None = None
    ) -> Floats32:
        """Log likelihoods of reference touches in every pose, or some, in n cells, ``(P, n, M)``.

        ``level`` is 0 for the coarsest cells.
        """

    def looked(self, belief: CoarseToFine) -> CoarseToFine:
        """The belief after a closer look at bodies that are still possible, where that may decide anything."""

    def fields(self) -> dict[str, Any]:
        """All that the likelihoods follow from, as JSON types."""


class StrangerTest(Protocol):
    """Weighs whether an object has none of the bodies."""

    def log_ratio(self, evidence: NestedEvidence) -> float:
        """Log likelihood ratio of all touches, of another body against equally probable listed ones."""

    def fields(self) -> dict[str, Any]:
        """All that it follows from beside the bodies, as JSON types."""


@dataclass(frozen=True, eq=False)
class NestedBodyModel(ArrayModel):
    """Joint posterior over one of K bodies and its orientation, coarse to fine.

    Attributes:
        shape_labels: names of the K bodies.
        cells: nested cells of orientations.
        bodies: likelihoods of touches.
        scale: factor of log likelihood ratios, the inverse of a temperature.
        drift: κ in [0, 1], correlation of the reader's errors about one object in different poses.
        references: embeddings of M touches that stand for all, ``(M, D)``.
        constants: by how much the log likelihood of each reference is too large, ``(M,)``.
        effort: limits on the refinement.
        correlation: ρ in [0, 1] of repeats in one pose.
        strangers: weighs whether an object has none of the bodies; None: touches tell nothing about that.
        moves: kernel of the coarsest cells, and the probability that a body moves so between two touches. There is then
            no closer look, which is at bodies at rest, and each touch keeps the weight that it has when it is made.
    """

    name: ClassVar[str] = "nested bodies"
    reads: ClassVar[Reads] = "embeddings"
    shape_labels: tuple[str, ...]
    cells: NestedCells
    bodies: BodyLikelihood
    scale: Annotated[float, Within(0.0, 1e6)]
    drift: Probability
    references: Floats32
    constants: Floats32
    effort: Effort = field(default_factory=Effort)
    correlation: Probability = ASSUMED_CORRELATION
    strangers: StrangerTest | None = None
    moves: tuple[CellKernel, float] | None = None

    def __post_init__(self) -> None:
        if self.references.ndim != 2 or not self.references.size or self.constants.shape != self.references.shape[:1]:
            raise ValueError(
                f"references must be (M, D) and constants (M,), got {self.references.shape} and {self.constants.shape}"
            )
        check(self)
        self.freeze()

    @property
    def num_poses(self) -> int:
        """See :class:`ArrayModel`."""
        return self.bodies.num_poses

    @property
    def default_outcomes(self) -> int:
        """See :class:`ArrayModel`: 128, or one for each reference."""
        return min(_OUTCOMES, len(self.references))

    @property
    def repeat_correlation(self) -> float:
        """See :class:`ArrayModel`."""
        return self.correlation

    def start(self) -> NestedEvidence:
        """See :class:`ArrayModel`."""
        return self._start

    @cached_property
    def _start(self) -> NestedEvidence:
        prior = np.zeros(len(self.shape_labels))
        drift = self.drift if self.moves is None else 0.0
        belief = CoarseToFine.start(prior, self.cells, self.bodies, self.effort, self.scale, drift, self.moves)
        return NestedEvidence(self, belief)

    def embedding_of(self, touch: Touch) -> Floats32:
        """The embedding that a touch brings, ``(D,)``; raises ValueError for a touch that does not fit the model."""
        wanted = self.references.shape[1]
        if touch.elsewhere is not None:
            raise ValueError("a belief about nested cells knows touches in its poses only, not in other places")
        if touch.features is None or touch.features.shape != (wanted,) or touch.pose >= self.num_poses:
            found = "none" if touch.features is None else f"{touch.features.shape}"
            raise ValueError(
                f"a touch must have an embedding of {wanted} numbers as its features, got {found}, and a pose below "
                f"{self.num_poses}, got {touch.pose}"
            )
        if not np.isfinite(touch.features).all():
            raise ValueError("the features of a touch must be finite")
        return np.asarray(touch.features, np.float32)

    def logits(self, pose: int, embedding: NDArray[np.floating]) -> Floats:
        """Log mean likelihood ratio of a touch under each body by its coarsest cells, ``(K,)``."""
        scores = self.scale * self.bodies.coarsest(self.bodies.felt(pose, embedding))
        return np.asarray(scipy.special.logsumexp(scores + self.cells.log_shares[0], axis=1), np.float64)

    def outcome_probs(
        self, leaves: Leaves, num_new: float, num_outcomes: int, poses: Sequence[int] | None = None
    ) -> Floats32:
        """p(reference touch | pose, cell) of the next touch after ``num_new`` others, ``(P, n, M)``."""
        kept = np.linspace(0, len(self.references) - 1, min(num_outcomes, len(self.references))).round().astype(int)
        ratios = self.bodies.log_ratios(leaves.level, leaves.body, leaves.cell, self.references[kept], poses)
        ratios -= self.constants[kept]
        ratios *= np.float32(self.scale / (1.0 + self.drift * num_new))
        return bounded_softmax(ratios)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        found = []
        for row in range(len(batch)):
            evidence = self.start()
            for touch in batch.sequence(row):
                evidence = evidence.update(touch)
            found.append(evidence.log_likelihood)
        return np.stack(found)

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`: one finest cell for each object, then references by their ratio in it."""
        finest, number = len(self.cells.shares) - 1, len(poses)
        cells = rng.choice(len(self.cells.shares[-1]), size=number, p=self.cells.shares[-1])
        leaves = Leaves(np.full(number, finest), np.full(number, shape), cells, np.zeros(number))
        probs = self.outcome_probs(leaves, 0.0, len(self.references))  # (P, S, M)
        above = probs[poses, np.arange(number)[:, None]].cumsum(axis=2)
        drawn = (rng.random((*poses.shape, 1)) * above[..., -1:] >= above).sum(axis=2)
        features = self.references[np.minimum(drawn, len(self.references) - 1)]
        return TouchBatch(poses, None, features)

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`: single touches are references; objects lie anyhow, so that all poses are alike."""
        number, shares, found = len(self.shape_labels), self.cells.shares[0], []
        for first in range(0, number, _AT_ONCE):
            some = np.arange(first, min(first + _AT_ONCE, number))
            bodies, cells = some.repeat(len(shares)), np.tile(np.arange(len(shares)), len(some))
            leaves = Leaves(0 * cells, bodies, cells, np.zeros(len(cells)))
            probs = self.outcome_probs(leaves, 0.0, num_outcomes, [0])[0]
            found.append(np.einsum("c,kcm->km", shares, probs.reshape(len(some), len(shares), -1)))
        return OutcomeTable(np.broadcast_to(np.concatenate(found), (self.num_poses, number, found[0].shape[1])))

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`; no file is read back, as bodies are embedded by the reader."""
        arrays = {name: array_field(getattr(self, name), "float16") for name in ("references", "constants")}
        numbers = {name: getattr(self, name) for name in ("scale", "drift", "correlation")}
        others = {"effort": vars(self.effort), "bodies": self.bodies.fields()}
        kernel = {} if self.moves is None else {"moves": [self.moves[1], self.moves[0].fingerprint]}
        return {**numbers, **arrays, **others, "strangers": self.strangers and self.strangers.fields(), **kernel}

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> ArrayModel:
        """Raise ValueError: the bodies are no part of the fields."""
        raise ValueError("a model of nested bodies is made by a sensor from their meshes, not read from a file")


@dataclass(frozen=True, eq=False)
class NestedEvidence:
    """The evidence about one rigid body, coarse to fine: a frozen value, of which an update makes a new one.

    ``in_pose`` has the number of touches in each pose and the sum of their embeddings. ``images`` has the pose and the
    image of each touch, where touches have one and the model weighs strangers.
    """

    model: NestedBodyModel
    belief: CoarseToFine
    in_pose: Mapping[int, tuple[int, Floats32]] = field(default_factory=dict)
    images: tuple[tuple[int, NDArray[np.uint8]], ...] = ()

    @property
    def num_touches(self) -> int:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return sum(number for number, _ in self.in_pose.values())

    @property
    def log_bets(self) -> None:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`; None, as the model has no conflict test."""
        return None

    @cached_property
    def log_likelihood(self) -> Floats:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        if not self.in_pose:
            return frozen(np.zeros(len(self.model.shape_labels)))
        found = self.belief.log_evidence
        return frozen(found - found.max())

    @cached_property
    def log_unlisted(self) -> float:
        """See :class:`~belief.observation_model.evidence.WeighsStrangers`; computed when it is asked for."""
        if not self.in_pose:
            return 0.0
        logs, strangers = self.log_likelihood, self.model.strangers
        ratio = 0.0 if strangers is None else strangers.log_ratio(self)
        return ratio + float(scipy.special.logsumexp(logs)) - float(np.log(len(logs)))

    @property
    def effective(self) -> dict[int, Floats32]:
        """For each touched pose, the sum of embeddings that counts: of repeats, less than all, ``(D,)``."""
        return {
            pose: total * np.float32(effective_touches(number, self.model.correlation) / number)
            for pose, (number, total) in self.in_pose.items()
        }

    def update(self, touch: Touch) -> NestedEvidence:
        """The evidence with one more touch."""
        embedding, correlation = self.model.embedding_of(touch), self.model.correlation
        number, total = self.in_pose.get(touch.pose, (0, np.zeros_like(embedding)))
        in_pose = {**self.in_pose, touch.pose: (number + 1, total + embedding)}
        if self.model.moves is None:
            shares = effective_touches([number, number + 1], correlation) / (max(number, 1), number + 1)
            more = np.float32(shares[1]) * (total + embedding) - np.float32(shares[0]) * total
        else:
            more = np.float32(new_shares(self._counts, correlation, self.model.drift)[touch.pose]) * embedding
        num_new = float(effective_touches([many for many, _ in in_pose.values()], correlation).sum())
        belief = self.belief.update(self.model.bodies.felt(touch.pose, more), num_new)
        images = self.images
        if self.model.strangers is not None and touch.image is not None:
            images = *images, (touch.pose, touch.image)
        looked = belief if self.model.moves is not None else self.model.bodies.looked(belief)
        return NestedEvidence(self.model, looked, in_pose, images)

    @property
    def moved(self) -> Floats:
        """Probability of a move just before the last touch, given each body, ``(K,)``."""
        found = self.belief.moved
        return np.zeros(len(self.model.shape_labels)) if found is None else found

    @property
    def _counts(self) -> Floats:
        """Number of touches in each pose, ``(P,)``."""
        counts = np.zeros(self.model.num_poses)
        for pose, (number, _) in self.in_pose.items():
            counts[pose] = number
        return counts

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> NestedMixture:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`; outcomes are the model's references."""
        key = num_outcomes, num_hypotheses
        if key not in self._mixtures:
            self._mixtures[key] = NestedMixture(self, num_outcomes, _PER_SHAPE * num_hypotheses)
        return self._mixtures[key]

    @cached_property
    def _mixtures(self) -> dict[tuple[int, int], NestedMixture]:
        return {}


@dataclass(frozen=True, eq=False)
class NestedMixture:
    """Outcomes of the next touches (:class:`~belief.observation_model.outcome_mixture.Outcomes`), by drawn cells.

    Cells are drawn without chance for the bodies that the factors of a question weigh, ``number`` of them at most.
    """

    evidence: NestedEvidence
    num_outcomes: int
    number: int

    @cached_property
    def new(self) -> Floats:
        """See :class:`~belief.observation_model.outcome_mixture.Outcomes`."""
        # The drift is in the probabilities.
        return new_shares(self.evidence._counts, self.evidence.model.correlation, 0.0)

    @cached_property
    def table(self) -> OutcomeTable:
        """p(outcome | pose, shape), averaged over the cells."""
        return OutcomeTable(with_nothing_new(self.one_touch(np.eye(len(self.evidence.model.shape_labels))), self.new))

    def one_touch(self, factors: Floats) -> Floats32:
        """See :meth:`~belief.observation_model.outcome_mixture.OutcomeMixture.one_touch`."""
        shares, probs = self._drawn(factors)
        return np.asarray(shares @ probs)

    def of_hypotheses(self, belief: Floats) -> Floats32:
        """See :class:`~belief.observation_model.outcome_mixture.Outcomes`."""
        shares, probs = self._drawn(belief[None])
        return np.asarray(shares[0, :, None] * probs)

    def payoffs_after(self, payoffs: Floats, belief: Floats) -> tuple[Floats, Floats]:
        """See :class:`~belief.observation_model.outcome_mixture.Outcomes`."""
        factors = np.vstack([payoffs * belief, belief])
        joint = with_nothing_new(self.one_touch(factors), self.new).astype(np.float64)
        joint[..., -1] *= factors.sum(axis=1)
        return joint[:, :-1].transpose(1, 0, 2), joint[:, -1]

    def two_touches(self, pose: int, factors: Floats) -> Floats32:
        """See :meth:`~belief.observation_model.outcome_mixture.OutcomeMixture.two_touches`."""
        shares, probs = self._drawn(factors)
        of_next = with_nothing_new(probs, self.new)  # (P, n, M)
        rows = np.ascontiguousarray(of_next.transpose(1, 0, 2)).reshape(probs.shape[1], -1)
        found = np.stack([(of_next[pose] * share[:, None]).T @ rows for share in shares])
        return np.asarray(found.reshape(len(factors), of_next.shape[2], len(of_next), of_next.shape[2]))

    def _drawn(self, factors: Floats) -> tuple[Floats32, Floats32]:
        """Factors ``(J, n)`` of cells that stand for all bodies, and their outcomes ``(P, n, M)``.

        The last cell stands for the bodies without a cell: each outcome is equally probable.
        """
        key = factors.tobytes()
        if (found := self._kept.get(key)) is None:
            found = self._draw(factors)
            self._kept.clear()
            self._kept[key] = found
        return found

    @cached_property
    def _kept(self) -> dict[bytes, tuple[Floats32, Floats32]]:
        return {}

    def _draw(self, factors: Floats) -> tuple[Floats32, Floats32]:
        belief, sizes = self.evidence.belief, np.maximum(np.abs(factors), _TINY)
        parts = sizes.sum(axis=1, keepdims=True) / sizes.sum()
        wanted = (sizes * -np.log(parts * (1.0 - 1e-9))).sum(axis=0)  # answers count by what they add to an entropy
        order = np.argsort(-wanted)
        most = np.searchsorted(np.cumsum(wanted[order]), (1.0 - 0.5 / self.number) * wanted.sum())
        leaves = belief.leaves_of(np.sort(order[: most + 1]))
        weights = np.exp(leaves.log_weight - belief.log_of_bodies[leaves.body]) * wanted[leaves.body]
        above = np.cumsum(weights)
        drawn = np.searchsorted(above, (np.arange(self.number) + 0.5) / self.number * above[-1:].sum())
        rows, counts = np.unique(drawn[drawn < len(above)], return_counts=True)
        chosen = Leaves(*(part[rows] for part in leaves))
        of_body = np.bincount(chosen.body, counts, minlength=len(wanted))
        shares = factors[:, chosen.body] * (counts / of_body[chosen.body])
        rest = factors @ (of_body == 0.0)
        probs = self.evidence.model.outcome_probs(chosen, belief.num_new, self.num_outcomes)
        even = np.full((len(probs), 1, probs.shape[2]), 1.0 / probs.shape[2], np.float32)
        return np.column_stack([shares, rest]).astype(np.float32), np.concatenate([probs, even], axis=1)
