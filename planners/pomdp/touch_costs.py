"""What touches cost, and how much of a fresh touch each of an object's touches is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from belief.errors import InvalidArgument


@dataclass(frozen=True)
class TouchTerms:
    """Terms on which one object can be touched, as often as one likes.

    Attributes:
        cost: λ.
        discount: γ, per touch.
        weights: the t-th touch shows an outcome with probability ``weights[t]``, else nothing; the last holds for all
            that follow. Not increasing, in [0, 1]. Touches that are all fresh by default.

    >>> TouchTerms(0.02, 1.0, (1.0, 0.5)).lasting        # half of them show nothing: an outcome costs twice as much
    (0.04, 1.0)
    """

    cost: float
    discount: float = 1.0
    weights: Sequence[float] = (1.0,)

    def __post_init__(self) -> None:
        falling = all(a >= b for a, b in zip(self.weights, self.weights[1:], strict=False))
        if not (np.isfinite(self.cost) and self.cost >= 0.0 and 0.0 < self.discount <= 1.0):
            raise InvalidArgument(f"need a finite cost ≥ 0 and a discount in (0, 1], got {self.cost}, {self.discount}")
        if not (self.weights and falling and self.weights[0] <= 1.0 and self.weights[-1] >= 0.0):
            raise InvalidArgument(
                f"weights must be one or more numbers in [0, 1] that do not increase, got {self.weights}"
            )

    @property
    def lasting(self) -> tuple[float, float]:
        """Cost and discount of an outcome once the last weight holds.

        A touch that shows nothing leaves all as it was: whoever touches then goes on until one shows something.
        """
        weight = self.weights[-1]
        if weight == 0.0:
            return float("inf"), self.discount
        rate = 1.0 - self.discount * (1.0 - weight)
        return self.cost / rate, self.discount * weight / rate

    def weight(self, touches: int) -> float:
        """Of the next touch once so many were made."""
        return self.weights[min(touches, len(self.weights) - 1)]

    def after(self, touches: int) -> TouchTerms:
        """The terms once so many touches were made."""
        return TouchTerms(self.cost, self.discount, tuple(self.weights[touches:]) or (self.weights[-1],))
