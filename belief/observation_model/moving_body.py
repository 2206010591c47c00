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

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from belief.cell_kernel import CellKernel
from belief.constraints import Probability, check
from belief.frozen import frozen
from belief.observation_model.outcome_mixture import log_means
from belief.observation_model.repeat_discount import repeat_shares
from belief.observation_model.rigid_body import RigidBodyModel
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence, relative
from belief.problem import Touch
from belief.validation import Floats

if TYPE_CHECKING:
    pass

Place = int | tuple[float, ...]
_MOST = 1.0 - 1e-12  # probability of a move


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

    def start(self) -> MovingEvidence:
        """See :class:`ArrayModel`."""
        zeros = np.zeros((len(self.shape_labels), self.num_hypotheses))
        return MovingEvidence(self, frozen(zeros), frozen(zeros[:, 0]))

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`; no file is read back: a scene says how bodies move."""
        kernels = [None if one is None else one.fingerprint for one in (self.kernel, self.error)]
        return {**super().to_fields(), "moves": [self.prob, *kernels]}


@dataclass(frozen=True, eq=False)
class MovingEvidence(RigidBodyEvidence):
    """The evidence about one body that may move between touches.

    Attributes:
        felt: place and scores ``(K, N)`` of every touch, oldest first.
        stayed: log weights before the last touch, its counted scores, ``(K, N)`` each, and what was subtracted from
            their sum; None where no move is possible.
    """

    model: MovingBodyModel
    felt: tuple[tuple[Place, NDArray[Any]], ...] = ()
    stayed: tuple[Floats, NDArray[Any], float] | None = None

    def update(self, touch: Touch) -> MovingEvidence:
        """The evidence with one more touch; where it changes the weight of others, all are gone through again.

        Touches count as those of a body at rest (:func:`repeat_shares`).
        """
        model, first, constant = self.model, self.num_touches, self.constant
        scores = model.scores_of(touch, model.embedding_of(touch))
        place: Place = int(touch.pose) if touch.elsewhere is None else touch.elsewhere.place
        felt, weights = (*self.felt, (place, frozen(scores))), self.log_weights
        is_repeat = any(place == where for where, _ in self.felt)
        shares = np.ones(len(felt))
        if first and (model.drift or (model.correlation and is_repeat)):
            places = list(dict.fromkeys(where for where, _ in felt))
            rows = np.array([[places.index(where) for where, _ in felt]])
            shares = repeat_shares(rows, model.correlation, model.drift)[0]
            weights, first, constant = np.zeros_like(weights), 0, 0.0
        before, counted = weights, scores
        for step in range(first, len(felt)):
            before, counted = weights, felt[step][1] if shares[step] == 1.0 else shares[step] * felt[step][1]
            weights = (model.before_next(weights) if step else weights) + counted
        log_weights, log_likelihood, largest = relative(weights)
        in_pose = self.in_pose
        if model.correlation or model.drift:
            in_pose = {**in_pose, place: (in_pose.get(place, (0,))[0] + 1, np.zeros(0))}
        stayed = (before, counted, float(largest)) if len(felt) > 1 and model.kernel is not None else None
        number, constant = self.num_touches + 1, constant + float(largest)
        return MovingEvidence(
            model, log_weights, log_likelihood, number, in_pose, constant=constant, felt=felt, stayed=stayed
        )

    @cached_property
    def moved(self) -> Floats:
        """Probability of a move just before the last touch, given each shape and all touches, ``(K,)``."""
        if self.stayed is None:
            return np.zeros(len(self.log_likelihood))
        before, counted, largest = self.stayed
        logs = log_means(before + counted) + np.log1p(-min(self.model.prob, _MOST)) - largest
        return np.clip(-np.expm1(logs - self.log_likelihood), 0.0, 1.0)
