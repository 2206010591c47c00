"""An observation model that also knows strangers: objects of none of the known shapes.

The touches of a stranger have the mean likelihood of the known shapes, times the object's e-value, which bets of the
conflict test (:mod:`belief.conflict`) on a high misfit have won. The prior, or the composition of the search, says how
probable strangers are. A stranger's next touch is predicted as that of the known shapes that are still possible.

>>> from types import SimpleNamespace
>>> for bets in (-2.0, 6.0):  # touches that fit a known shape, and touches that fit none
...     known = SimpleNamespace(num_touches=3, log_likelihood=np.log([0.9, 0.1]), log_bets=np.full(12, bets))
...     print(softmax(StrangerEvidence(known).log_likelihood).round(3).tolist())
[0.843, 0.094, 0.063]
[0.004, 0.0, 0.995]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from belief.conflict import log_conflict
from belief.errors import InvalidArgument
from belief.frozen import frozen
from belief.naming import checked_names
from belief.observation_model.evidence import ObjectEvidence, start
from belief.observation_model.model import ObservationModel
from belief.observation_model.outcome_mixture import Outcomes
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Touch
from belief.validation import Floats


@dataclass(frozen=True)
class StrangerModel:
    """A model with a conflict test, and one more shape, the last: that of objects of none of its shapes.

    >>> from belief.synthetic import random_model
    >>> try:
    ...     StrangerModel(random_model(np.random.default_rng(0)))
    ... except InvalidArgument as error:
    ...     print(error)
    strangers are told by a conflict test, and ConfusionModel has none; sensors about one rigid body have one
    """

    known: ObservationModel
    label: str = "stranger"

    def __post_init__(self) -> None:
        checked_names("shape_labels", self.shape_labels)
        if start(self.known).log_bets is None:
            raise InvalidArgument(
                f"strangers are told by a conflict test, and {type(self.known).__name__} has none; sensors "
                "about one rigid body have one"
            )

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """Names of the known shapes, then that of strangers."""
        return (*self.known.shape_labels, self.label)

    @property
    def repeat_correlation(self) -> float | None:
        """Repeat correlation of the known model."""
        return getattr(self.known, "repeat_correlation", None)

    def start(self) -> StrangerEvidence:
        """The evidence before the first touch."""
        return StrangerEvidence(start(self.known))

    def log_likelihood(self, touches: Sequence[Touch]) -> Floats:
        """Log p(all these touches of one object | shape) up to a constant, ``(K + 1,)``; zeros for no touches."""
        evidence = self.start()
        for touch in touches:
            evidence = evidence.update(touch)
        return evidence.log_likelihood

    def sample(self, shape: int, poses: Sequence[int], rng: np.random.Generator) -> list[Touch]:
        """Sampled touches of an object of a known shape; InvalidArgument for strangers, whose touches are unknown."""
        if shape == len(self.shape_labels) - 1:
            raise InvalidArgument("touches of a stranger cannot be sampled: its shape is unknown")
        return self.known.sample(shape, poses, rng)

    def outcome_table(self, num_outcomes: int | None = None) -> OutcomeTable:
        """Table of the known model, and for strangers the mean outcome probabilities of the known shapes."""
        probs = self.known.outcome_table(num_outcomes).probs
        return OutcomeTable(_with_stranger(probs, np.full(probs.shape[1], 1.0 / probs.shape[1])))


@dataclass(frozen=True, eq=False)
class StrangerEvidence:
    """The evidence about an object that may be a stranger, from that of the known model."""

    known: ObjectEvidence

    @property
    def num_touches(self) -> int:
        """Number of touches."""
        return self.known.num_touches

    @property
    def log_bets(self) -> None:
        """None: touches that fit no known shape do not speak against this model."""

    def update(self, touch: Touch) -> StrangerEvidence:
        """The evidence with one more touch; raises ValueError for a touch that does not fit the model."""
        return StrangerEvidence(self.known.update(touch))

    @cached_property
    def log_likelihood(self) -> Floats:
        """Log p(all these touches | shape) up to a constant, ``(K + 1,)``, read-only; zeros for no touches."""
        known, bets = self.known.log_likelihood, self.known.log_bets
        if not self.num_touches or bets is None:
            return frozen(np.zeros(len(known) + 1))
        mean = logsumexp(known) - np.log(len(known))
        if np.isneginf(mean):  # no known shape is possible
            return frozen(np.append(known, 0.0))
        # A stranger looks familiar from each side, but the sides do not fit one body: bets on misfit alone count.
        return frozen(np.append(known, mean + log_conflict([bets[1:3] if len(bets) == 12 else bets])))

    def outcome_mixture(self, num_outcomes: int, num_hypotheses: int) -> Outcomes | None:
        """The outcomes of the next touch, given these touches; see :class:`ObjectEvidence`."""
        known = self.known.outcome_mixture(num_outcomes, num_hypotheses)
        if known is None:
            return None
        logs = self.known.log_likelihood
        possible = softmax(logs) if np.isfinite(logs.max()) else np.full(len(logs), 1.0 / len(logs))
        return _StrangerOutcomes(known, frozen(possible))


@dataclass(frozen=True, eq=False)
class _StrangerOutcomes:
    """Outcomes of the next touches; a stranger's are those of the known shapes, weighted by ``possible (K,)``."""

    known: Outcomes
    possible: Floats

    @property
    def new(self) -> Floats | None:
        return self.known.new

    @cached_property
    def table(self) -> OutcomeTable:
        return OutcomeTable(_with_stranger(self.known.table.probs, self.possible))

    def one_touch(self, factors: Floats) -> NDArray[Any]:
        return self.known.one_touch(self._of_known(factors))

    def two_touches(self, pose: int, factors: Floats) -> NDArray[np.float32]:
        return self.known.two_touches(pose, self._of_known(factors))

    def _of_known(self, factors: Floats) -> Floats:
        return np.asarray(factors[:, :-1] + factors[:, -1:] * self.possible)


def _with_stranger(probs: Floats, weights: Floats) -> Floats:
    """Outcome probabilities ``(P, K, M)`` with one more shape, the weighted mean of the others."""
    return np.concatenate([probs, (weights[:, None] * probs).sum(axis=1, keepdims=True)], axis=1)
