"""Evidence about one object, updated touch by touch.

>>> from belief.synthetic import random_model
>>> model = random_model(np.random.default_rng(0), num_shapes=2)
>>> touch = Touch(0, np.array([1.0, 0.0]))
>>> counted, asked = SummarisedEvidence(model).update(touch), RecomputedEvidence(model).update(touch)
>>> counted.num_touches, bool((counted.log_likelihood == asked.log_likelihood).all())
(1, True)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from belief.frozen import frozen
from belief.observation_model.outcome_mixture import Outcomes
from belief.problem import Touch
from belief.validation import Floats


class ObjectEvidence(Protocol):
    """The evidence about one object: an immutable value; each touch gives a new one."""

    @property
    def num_touches(self) -> int:
        """Number of touches."""

    @property
    def log_likelihood(self) -> Floats:
        """Log p(all these touches | shape) up to a constant, ``(K,)``, read-only; zeros for no touches."""

    @property
    def log_bets(self) -> Floats | None:
        """Log wealth of the strategies that bet against "these touches come from the world that the model knows".

        ``(J,)``, read-only; None for a model without such a test. See :mod:`belief.conflict`.
        """

    def update(self, touch: Touch) -> Self:
        """The evidence with one more touch."""

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> Outcomes | None:
        """The outcomes of the next touch, given these touches; None where they do not depend on them.

        Args:
            num_outcomes: largest number of outcomes M.
            num_hypotheses: largest number of hypotheses H of each shape.
        """


@runtime_checkable
class WeighsStrangers(Protocol):
    """Evidence that also weighs whether the object has none of the shapes: an optional part of :class:`ObjectEvidence`.

    See :attr:`belief.SearchProblem.unlisted`.
    """

    @property
    def log_unlisted(self) -> float:
        """Log p(all these touches | another shape than the listed ones), up to the constant of the log-likelihood.

        Its difference to the log mean of the likelihoods is the log likelihood ratio of an unlisted shape against
        equally probable listed ones; 0 before the first touch.
        """


class Explains(Protocol):
    """An observation model that has only the likelihood of touches."""

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """Names of the K shapes."""

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """Log p(all these touches of one object | shape) up to a constant, ``(K,)``."""


@runtime_checkable
class Summarises(Explains, Protocol):
    """An observation model whose likelihood depends on touches through statistics of fixed size."""

    def statistics_with(self, statistics: Any, touch: Touch) -> Any:
        """New statistics: the given ones (None before the first touch) with one more touch."""

    def log_likelihood_of(self, statistics: Any) -> Floats:
        """Log p(all these touches | shape) up to a constant, ``(K,)``, of the statistics of at least one touch."""


class _OfIndependentTouches:
    """Evidence of a model without a conflict test, whose touches are independent given the shape."""

    @property
    def log_bets(self) -> Floats | None:
        """See :class:`ObjectEvidence`; None, as the model has no test."""
        return None

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> Outcomes | None:
        """See :class:`ObjectEvidence`; None, as touches are taken as independent given the shape."""
        return None


@dataclass(frozen=True, eq=False)
class SummarisedEvidence(_OfIndependentTouches):
    """Evidence as statistics of fixed size, None before the first touch; the cost of a touch is constant."""

    model: Summarises
    statistics: Any = None
    num_touches: int = 0

    def update(self, touch: Touch) -> Self:
        """See :class:`ObjectEvidence`; raises ValueError for a touch that does not fit the model."""
        return type(self)(self.model, self.model.statistics_with(self.statistics, touch), self.num_touches + 1)

    @cached_property
    def log_likelihood(self) -> Floats:
        """See :class:`ObjectEvidence`."""
        if self.num_touches == 0:
            return frozen(np.zeros(len(self.model.shape_labels)))
        return frozen(self.model.log_likelihood_of(self.statistics))


@dataclass(frozen=True, eq=False)
class RecomputedEvidence(_OfIndependentTouches):
    """Evidence as a list of touches, oldest first; the model computes the likelihood of all after each touch."""

    model: Explains
    touches: tuple[Touch, ...] = ()

    @property
    def num_touches(self) -> int:
        """See :class:`ObjectEvidence`."""
        return len(self.touches)

    def update(self, touch: Touch) -> RecomputedEvidence:
        """See :class:`ObjectEvidence`."""
        return RecomputedEvidence(self.model, (*self.touches, touch))

    @cached_property
    def log_likelihood(self) -> Floats:
        """See :class:`ObjectEvidence`."""
        return frozen(np.asarray(self.model.log_likelihood(self.touches)))


def start(model: Explains) -> ObjectEvidence:
    """Evidence before the first touch: ``model.start()``, or :class:`RecomputedEvidence` for models without it."""
    begin = getattr(model, "start", None)
    return RecomputedEvidence(model) if begin is None else begin()
