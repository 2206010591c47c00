"""Bodies whose proportions may be other than their nominal ones: a latent of the evidence about one object.

The nominal model has the likelihood of touches of a shape with its nominal proportions. For some shapes, another reader
also scores hypotheses of other proportions. Both are taken relative to what each reader expects of a single touch of a
usual object, so that they can be added: the likelihood of a shape is that of its nominal proportions by their prior,
and that of all others by the rest. The answer is the shape.

A cup that the nominal model takes for a mug, unless cups may be longer:

>>> from belief.observation_model import FixedHypotheses, RigidBodyModel
>>> table = np.array([[[[2.0, 0.0]], [[0.0, 2.0]]]], np.float32)                         # one pose, two shapes
>>> one = np.ones((1, 1, 2))
>>> nominal = RigidBodyModel(("mug", "cup"), 1, 1.0, one, one, hypotheses=FixedHypotheses(table))
>>> class LongCups:
...     shapes = np.array([1])
...     def log_ratios(self, touch): return np.full((1, 1), 4.0)
>>> model = VariedBodyModel(nominal, LongCups())
>>> touch = Touch(0, features=np.array([1.0, 0.0]), image=np.zeros((1, 1), np.uint8))
>>> evidence = model.start().update(touch).update(touch)
>>> [one.log_likelihood.argmax() for one in (evidence.nominal, evidence)]
[np.int64(0), np.int64(1)]
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from belief.constraints import Probability, check
from belief.frozen import frozen
from belief.observation_model.model import ArrayModel
from belief.observation_model.nominal import BesideNominal, OfNominal
from belief.observation_model.outcome_mixture import log_means
from belief.observation_model.rigid_body import RigidBodyModel
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence, SumsByPlace, with_touch
from belief.problem import Touch
from belief.validation import Floats

_EVERY = 4  # hypothesis of nominal proportions counts for what is expected of a touch
SHARE = 0.04
"""Prior probability that an object of a shape has other proportions than the nominal ones."""


class VariedHypotheses(Protocol):
    """Scores N hypotheses of other proportions of each of V shapes."""

    @property
    def shapes(self) -> NDArray[np.int64]:
        """Indices of the shapes that have them, ``(V,)``."""

    def log_ratios(self, touch: Touch) -> NDArray[np.floating] | None:
        """Log p(touch | hypothesis) / p(touch | some usual object), ``(V, N)``; None where the touch is not read."""


@dataclass(frozen=True, eq=False)
class VariedBodyModel(OfNominal, ArrayModel):
    """The joint model of one rigid body, whose proportions may be others than those of its shape.

    Elsewhere than in evidence, this is the nominal model: samples, tables, predicted outcomes and the file.

    Attributes:
        nominal: the shapes as described.
        varied: scores hypotheses of other proportions.
        share: prior probability of other proportions, of a shape that has them.
    """

    nominal: RigidBodyModel
    varied: VariedHypotheses
    share: Probability = SHARE

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape_labels", self.nominal.shape_labels)
        check(self)
        self.freeze()

    def start(self) -> VariedEvidence:
        """See :class:`ArrayModel`."""
        return VariedEvidence(self, self.nominal.start())


@dataclass(frozen=True, eq=False)
class VariedEvidence(BesideNominal):
    """Evidence about one object: the nominal one, and that of other proportions as long as all touches are read.

    ``log_weights (V, N)`` are log p(all touches | hypothesis of other proportions), up to the constant that the log
    weights of the nominal model have before they are made relative; ``sums`` are as in :class:`RigidBodyEvidence`.
    """

    model: VariedBodyModel
    nominal: RigidBodyEvidence
    log_weights: Floats | None = field(default=None, repr=False)
    sums: SumsByPlace = field(default_factory=dict, repr=False)

    def update(self, touch: Touch) -> VariedEvidence:
        """The evidence with one more touch."""
        nominal = self.model.nominal
        embedding = nominal.embedding_of(touch)
        scores = nominal.scores_of(touch, embedding)
        after = self.nominal.with_scores(touch, embedding, scores)
        is_whole = self.log_weights is not None or not self.num_touches
        ratios = self.model.varied.log_ratios(touch) if is_whole else None
        if ratios is None:
            return VariedEvidence(self.model, after)
        told = ratios + np.float64(log_means(scores[:, ::_EVERY].reshape(1, -1))[0])
        sums, weights = with_touch(self.sums, touch, told, nominal.correlation, nominal.drift)
        if weights is None:
            weights = told if self.log_weights is None else self.log_weights + told
        return VariedEvidence(self.model, after, weights, sums)

    @cached_property
    def log_likelihood(self) -> Floats:
        """See :class:`~belief.observation_model.evidence.ObjectEvidence`."""
        nominal, share = self.nominal, self.model.share
        if self.log_weights is None or not share:
            return nominal.log_likelihood
        found, shapes = nominal.log_likelihood.copy(), self.model.varied.shapes
        varied = log_means(self.log_weights) - nominal.constant
        with np.errstate(divide="ignore"):
            found[shapes] = np.logaddexp(np.log1p(-share) + found[shapes], np.log(share) + varied)
        return frozen(found)

    def untested(self) -> VariedEvidence:
        """The same evidence without the conflict test."""
        return replace(self, nominal=self.nominal.untested())

    @property
    def constant(self) -> float:
        """See :class:`RigidBodyEvidence`."""
        return self.nominal.constant

    @property
    def log_unlisted(self) -> float:
        """See :class:`~belief.observation_model.evidence.WeighsStrangers`."""
        return self.nominal.log_unlisted
