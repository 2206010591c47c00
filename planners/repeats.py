"""What one more touch in a pose that was used before is worth, in touches of a pose that is new.

Touches of one object in one pose repeat each other, so a table of single touches overstates what the next will tell.
How much is a property of the observation model: :func:`repeat_discount` reads it there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from belief.observation_model import ObservationModel
from belief.problem import Floats


class RepeatDiscount(Protocol):
    """Prices repeats."""

    def weights(self, uses: ArrayLike) -> Floats:
        """Share of a fresh touch's worth that the next touch in each pose has, in [0, 1].

        Args:
            uses: how often the object was touched in each pose, ``(..., P)``.

        Returns:
            ``(..., P)``; zero takes a pose out of the running.
        """


@dataclass(frozen=True)
class LeastUsedFirst:
    """Only poses used least compete: what to do when nothing is known about repeats (decision 0006).

    >>> LeastUsedFirst().weights([2, 1, 1]).tolist()
    [0.0, 1.0, 1.0]
    """

    def weights(self, uses: ArrayLike) -> Floats:
        """See :class:`RepeatDiscount`."""
        counts = np.asarray(uses)
        return (counts == counts.min(axis=-1, keepdims=True)).astype(np.float64)


@dataclass(frozen=True)
class CorrelatedRepeats:
    """Touches in one pose correlate by ρ: the n-th adds what n touches are worth beyond n - 1.

    Worth is counted in independent touches, :func:`belief.observation_model.repeat_discount.effective_touches`.

    Attributes:
        correlation: ρ, in [0, 1].

    Raises:
        ValueError: the correlation is none.

    >>> CorrelatedRepeats(0.5).weights([0, 1, 2]).round(3).tolist()        # 1, 4/3 and 3/2 touches in all
    [1.0, 0.333, 0.167]
    """

    correlation: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.correlation <= 1.0:
            raise ValueError(f"correlation must be in [0, 1], got {self.correlation}")

    def weights(self, uses: ArrayLike) -> Floats:
        """See :class:`RepeatDiscount`."""
        n, rho = np.asarray(uses, np.float64), self.correlation
        # The difference of effective_touches at n + 1 and n, without cancellation.
        return np.where(n > 0.0, (1.0 - rho) / ((1.0 + n * rho) * (1.0 + np.maximum(n - 1.0, 0.0) * rho)), 1.0)


def weights_in_turn(repeats: RepeatDiscount, num_poses: int, times: int) -> Floats:
    """Worth of an object's first touch, its second, …, if no pose is used again before all others were; ``(P times,)``.

    Args:
        repeats: prices repeats.
        num_poses: P.
        times: how often each pose is used.

    >>> weights_in_turn(CorrelatedRepeats(0.5), 2, 2).round(3).tolist()
    [1.0, 1.0, 0.333, 0.333]
    """
    return np.repeat([repeats.weights(np.full(num_poses, used)).max() for used in range(times)], num_poses)


def repeat_discount(model: ObservationModel | None) -> RepeatDiscount:
    """The discount by the ``repeat_correlation`` of an observation model; :class:`LeastUsedFirst` if it has none.

    >>> repeat_discount(None)
    LeastUsedFirst()
    """
    correlation: float | None = getattr(model, "repeat_correlation", None)
    return LeastUsedFirst() if correlation is None else CorrelatedRepeats(correlation)
