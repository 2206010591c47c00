"""Cost of the touches of one object, and how much information repeated touches give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from belief.errors import InvalidArgument
from belief.validation import Floats


@dataclass(frozen=True)
class TouchCosts:
    """Cost, discount and repeat weights of the touches of one object; their number is not limited.

    Attributes:
        cost: λ.
        discount: γ, per touch.
        weights: touch t gives an outcome with probability ``weights[t]``, and nothing otherwise; the last weight holds
            for all later touches. They are in [0, 1] and do not increase.

    Raises:
        InvalidArgument: a number is out of its range.

    >>> TouchCosts(0.02, 1.0, (1.0, 0.5)).lasting        # half of them give nothing, so an outcome costs twice as much
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
        """Cost and discount of one outcome once the last weight holds.

        A touch without an outcome does not change the belief, so the same pose is touched until there is an outcome.
        """
        weight = self.weights[-1]
        if weight == 0.0:
            return float("inf"), self.discount
        rate = 1.0 - self.discount * (1.0 - weight) or weight  # a tiny weight is lost in the difference
        return self.cost / rate, self.discount * weight / rate

    @property
    def for_ever(self) -> float:
        """Value of touching without end, which postpones a failure; -inf without a discount.

        >>> round(TouchCosts(0.02, 0.9).for_ever, 6), TouchCosts(0.02).for_ever
        (-0.2, -inf)
        """
        return -self.cost / (1.0 - self.discount) if self.discount < 1.0 else -float("inf")

    def known(self, payoffs: Floats) -> Floats:
        """Value where the shape is known, by shape ``(K,)``, for payoffs of each answer ``(A, K)``."""
        return np.maximum(payoffs.max(axis=0), self.for_ever)

    def weight(self, touches: int) -> float:
        """Weight of the next touch after so many touches."""
        return self.weights[min(touches, len(self.weights) - 1)]

    def after(self, touches: int) -> TouchCosts:
        """The costs that hold after so many touches."""
        return TouchCosts(self.cost, self.discount, tuple(self.weights[touches:]) or (self.weights[-1],))
