r"""The joint model of one rigid body that may move between touches, or lies a little otherwise in every touch.

    p(i before touch t) = (1 - q) p(i after touch t - 1) + q ∑_j p(j after touch t - 1) K(j → i)

Before each touch but the first, the body moves with probability q, to hypotheses that lie nearby (:class:`CellKernel`).
A touch that fits none of the probable hypotheses, but some near them, is then evidence for a move
(:attr:`MovingEvidence.moved`). Where poses are missed, the likelihood of a touch is averaged in the same way: the body
may have lain in any nearby hypothesis, independently in each touch.

A mug whose two hypotheses change places in every second move, a cup that feels the same in both, and a last touch that
fits the other hypothesis of the mug:

>>> from belief.observation_model import FixedHypotheses
>>> table = FixedHypotheses(np.array([[[[3.0, 0.0], [0.0, 3.0]], [[1.0, 1.0], [1.0, 1.0]]]], np.float32))
>>> one = np.ones((1, 1, 2))
>>> still = RigidBodyModel(("mug", "cup"), 2, 1.0, references=one, reference_logits=one, hypotheses=table)
>>> kernel = CellKernel.of(np.ones((2, 2)), np.full(2, 0.5))
>>> evidence: MovingEvidence = MovingBodyModel.of(still, prob=0.2, kernel=kernel).start()
>>> for embedding in ([1.0, 0.0], [1.0, 0.0], [0.0, 1.0]):
...     evidence = evidence.update(Touch(0, features=np.array(embedding)))
>>> evidence.moved.round(2).tolist()
[0.7, 0.2]
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from belief.cell_kernel import CellKernel
from belief.constraints import Probability, check
from belief.frozen import frozen
from belief.observation_model.outcome_mixture import OutcomeMixture, SharedMixture
from belief.observation_model.repeat_discount import repeat_shares
from belief.observation_model.rigid_body import RigidBodyModel
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence, relative
from belief.problem import Touch
from belief.validation import Floats

Place = int | tuple[float, ...]
_TINY = 1e-290


@dataclass(frozen=True, eq=False)
class MovingBodyModel(RigidBodyModel):
    """Joint posterior over shape, orientation and size of a body that may move between touches.

    Other attributes are those of :class:`RigidBodyModel`; there is no conflict test, which holds for a body at rest.
    Predicted outcomes of the next touches suppose that it stays, and that poses are exact.

    Attributes:
        prob: probability of a move between two touches.
        kernel: where a move takes the body, among the N hypotheses; None for a body at rest.
        error: how it lies in a touch, apart from its hypothesis; None for exact poses.
    """

    name: ClassVar[str] = "moving rigid body"
    moves: ClassVar[bool] = True
    prob: Probability = field(kw_only=True)
    kernel: CellKernel | None = field(kw_only=True)
    error: CellKernel | None = field(kw_only=True)

    def __post_init__(self) -> None:
        check(self)
        for name in ("kernel", "error"):
            kernel = getattr(self, name)
            if kernel is not None and kernel.num_cells != self.num_hypotheses:
                raise ValueError(f"{name} is about {kernel.num_cells} hypotheses of {self.num_hypotheses}")
        super().__post_init__()

    @classmethod
    def of(
        cls, model: RigidBodyModel, prob: float = 0.0, kernel: CellKernel | None = None, error: CellKernel | None = None
    ) -> MovingBodyModel:
        """A model of bodies at rest, for bodies that move."""
        given = {part.name: getattr(model, part.name) for part in fields(RigidBodyModel)} | {"conflict": None}
        return cls(**given, prob=prob, kernel=kernel, error=error)

    def scores(self, pose: int, embeddings: Floats, shapes: slice = slice(None)) -> NDArray[Any]:
        """Log p(touch | hypothesis), ``(n, K, N)``."""
        found = super().scores(pose, embeddings, shapes)
        return found if self.error is None else self.error.mean(found)

    def scores_of(self, touch: Touch, embedding: Floats) -> NDArray[Any]:
        """Log p(touch | hypothesis) of one touch, ``(K, N)``."""
        found = super().scores_of(touch, embedding)
        return found if self.error is None or touch.elsewhere is None else self.error.mean(found)

    def before_next(self, log_weights: NDArray[Any]) -> NDArray[Any]:
        """Log weights ``(..., N)`` after a move that may have happened; the sums of the weights stay."""
        if self.kernel is None or not self.prob:
            return log_weights
        return self.kernel.moved(log_weights, self.prob).astype(log_weights.dtype, copy=False)

    def start(self) -> MovingEvidence:  # type: ignore[override]
        """See :class:`ArrayModel`."""
        shape = len(self.shape_labels), self.num_hypotheses
        nothing = frozen(np.zeros(shape[0]))
        return MovingEvidence(self, frozen(np.full(shape, 1.0 / shape[1])), nothing, nothing)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`; no file is read back: a scene says how bodies move."""
        kernels = [None if one is None else one.fingerprint for one in (self.kernel, self.error)]
        return {**super().to_fields(), "moves": [self.prob, *kernels]}


@dataclass(frozen=True, eq=False)
class MovingEvidence:
    """The evidence about one body that may move between touches: a frozen value, of which an update makes a new one.

    Attributes:
        probs: p(hypothesis | shape, touches), ``(K, N)``.
        log_evidence: log p(touches | shape) up to a constant, ``(K,)``.
        moved: probability of a move just before the last touch, given each shape and all touches, ``(K,)``.
        felt: place and scores ``(K, N)`` of every touch, oldest first.
    """

    model: MovingBodyModel
    probs: Floats
    log_evidence: Floats
    moved: Floats
    felt: tuple[tuple[Place, NDArray[Any]], ...] = ()

    def update(self, touch: Touch) -> MovingEvidence:
        """The evidence with one more touch; where it changes the weight of others, all are gone through again.

        Touches count as those of a body at rest (:func:`repeat_shares`).
        """
        model, known = self.model, self
        scores = model.scores_of(touch, model.embedding_of(touch))
        place: Place = int(touch.pose) if touch.elsewhere is None else touch.elsewhere.place
        felt = (*self.felt, (place, scores))
        is_repeat = any(place == where for where, _ in self.felt)
        shares = np.ones(len(felt))
        if self.felt and (model.drift or (model.correlation and is_repeat)):
            places = list(self._counts(felt))
            rows = np.array([[places.index(where) for where, _ in felt]])
            shares, known = repeat_shares(rows, model.correlation, model.drift)[0], model.start()
        probs, log_evidence, moved = known.probs, known.log_evidence, known.moved
        for step in range(len(known.felt), len(felt)):
            counted = felt[step][1] if shares[step] == 1.0 else np.float32(shares[step]) * felt[step][1]
            peaks = counted.max(axis=1, keepdims=True)
            fits = np.exp(counted - peaks)
            is_moving = step and model.kernel is not None and model.prob > 0.0
            before = probs * (1.0 - model.prob) if is_moving else probs
            joint = before * fits
            stayed = joint.sum(axis=1)
            if is_moving and model.kernel is not None:
                arrived = model.kernel.spread(probs)
                arrived *= model.prob
                arrived *= fits
                joint += arrived
            np.maximum(joint, _TINY, out=joint)
            total = joint.sum(axis=1)
            probs = np.divide(joint, total[:, None], out=joint)
            log_evidence = log_evidence + peaks[:, 0] + np.log(total)
            moved = np.clip(1.0 - stayed / total, 0.0, 1.0) if is_moving else np.zeros(len(total))
        for array in (probs, log_evidence, moved, scores):
            array.flags.writeable = False  # nobody else holds them
        return MovingEvidence(model, probs, log_evidence, moved, felt)

    @property
    def num_touches(self) -> int:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return len(self.felt)

    @property
    def log_bets(self) -> None:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`; None, as the model has no conflict test."""
        return None

    @property
    def log_likelihood(self) -> Floats:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return frozen(self.log_evidence - self.log_evidence.max())

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> OutcomeMixture | SharedMixture:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        return self.nominal.outcome_mixture(num_outcomes, num_hypotheses)

    @cached_property
    def nominal(self) -> RigidBodyEvidence:
        """The weights of the hypotheses as evidence about a body at rest, which predicts what it would feel like next.

        Its updates know of no move.
        """
        model = self.model
        log_weights, log_likelihood, _ = relative(np.log(self.probs) + self.log_evidence[:, None])
        is_discounted = model.correlation or model.drift
        counts = self._counts(self.felt) if is_discounted else {}
        in_pose = {place: (number, np.zeros(0)) for place, number in counts.items()}
        return RigidBodyEvidence(model, log_weights, log_likelihood, len(self.felt), in_pose)

    @staticmethod
    def _counts(felt: tuple[tuple[Place, NDArray[Any]], ...]) -> dict[Place, int]:
        """Number of touches in each place, in the order of the first ones."""
        return dict(Counter(place for place, _ in felt))
