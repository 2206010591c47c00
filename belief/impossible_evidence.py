"""What to do about evidence that contradicts everything believed in, and about a target ruled out from the start.

A policy is asked twice: it may temper every likelihood before Bayes' rule, and it is told when the rule has no answer.
Trackers take one as ``on_impossible``. To add a policy, write a class with the members of :class:`ImpossiblePolicy`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from belief.errors import ImpossibleObservation
from belief.problem import Floats


class ImpossiblePolicy(Protocol):
    """What a tracker does about impossible evidence."""

    def temper(self, log_likelihood: Floats) -> Floats:
        """The log-likelihood to believe in place of this one, ``(..., K)``."""

    def resolve(self, error: ImpossibleObservation) -> None:
        """Raise, or return to leave the belief as it was."""


@dataclass(frozen=True)
class RaiseImpossible:
    """Raise :class:`belief.ImpossibleObservation`; the belief stays as it was. What trackers do unless told otherwise.

    >>> from belief import BatchedBeliefTracker, ImpossibleObservation
    >>> tracker = BatchedBeliefTracker([[1.0, 0.0]], on_impossible=RaiseImpossible())
    >>> try:
    ...     tracker.update([[-np.inf, 0.0]])
    ... except ImpossibleObservation:
    ...     tracker.probs.tolist()
    [[1.0, 0.0]]
    """

    def temper(self, log_likelihood: Floats) -> Floats:
        """See :class:`ImpossiblePolicy`."""
        return log_likelihood

    def resolve(self, error: ImpossibleObservation) -> None:
        """See :class:`ImpossiblePolicy`."""
        raise error


RAISE = RaiseImpossible()
"""The policy of every tracker that is given no other."""


@dataclass(frozen=True)
class IgnoreImpossible:
    """Go on as if what is impossible had not been felt: neither the belief, nor the evidence, nor the history changes.

    >>> from belief import BatchedBeliefTracker
    >>> tracker = BatchedBeliefTracker([[1.0, 0.0], [0.5, 0.5]], on_impossible=IgnoreImpossible())
    >>> _ = tracker.update([[-np.inf, 0.0], [-np.inf, 0.0]])      # impossible in the first row only
    >>> tracker.probs.tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """

    def temper(self, log_likelihood: Floats) -> Floats:
        """See :class:`ImpossiblePolicy`."""
        return log_likelihood

    def resolve(self, error: ImpossibleObservation) -> None:
        """See :class:`ImpossiblePolicy`."""


@dataclass(frozen=True)
class FloorLikelihood:
    """Never let a likelihood rule a shape out: none is less than ``exp(log_floor)`` times the best one of its row.

    A likelihood of zero for all shapes then tells nothing. Where a tracker asks for the likelihood of all touches of an
    object at once, the floor is under that, so no object is ever surer than the floor; what the prior or the
    composition rules out stays out.

    Attributes:
        log_floor: finite and negative; -20 is one in 5e8.

    Raises:
        ValueError: a floor that is not finite or not negative.

    >>> FloorLikelihood(-20.0).temper(np.array([[-5.0, -np.inf], [-np.inf, -np.inf]])).tolist()
    [[-5.0, -25.0], [0.0, 0.0]]
    """

    log_floor: float = -20.0

    def __post_init__(self) -> None:
        if not -np.inf < self.log_floor < 0.0:
            raise ValueError(f"log_floor must be finite and negative, got {self.log_floor}")

    def temper(self, log_likelihood: Floats) -> Floats:
        """See :class:`ImpossiblePolicy`."""
        values = np.asarray(log_likelihood, np.float64)
        best = values.max(axis=-1, keepdims=True, initial=-np.inf)
        with np.errstate(over="ignore"):  # a floor below the least float is none
            return np.maximum(values, np.where(best == -np.inf, 0.0, best + self.log_floor))

    def resolve(self, error: ImpossibleObservation) -> None:
        """See :class:`ImpossiblePolicy`; only what was told for certain can still contradict itself."""
        raise error


class ZeroPriorTarget(UserWarning):
    """The shape sought has prior probability zero: no touch can ever find it."""


def warn_of_zero_prior(target: str, where: str) -> None:
    """Warn the caller of a constructor that its target can never be found.

    >>> with warnings.catch_warnings(record=True, action="always") as caught:
    ...     warn_of_zero_prior("cone", "the bag")
    >>> print(caught[0].message)
    the target cone has probability zero in the bag: no touch can ever find it
    """
    warnings.warn(
        ZeroPriorTarget(f"the target {target} has probability zero in {where}: no touch can ever find it"),
        stacklevel=3,
    )
