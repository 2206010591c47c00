"""Discounts of repeated touches: the value of one more touch in a used pose, as a fraction of a new touch's value.

Touches of one object in one pose are correlated, so a table of single touches overstates the information of a repeat.
:func:`repeat_discount` takes the discount from the observation model (decision 0021).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from belief.constraints import Probability, check
from belief.observation_model.model import ObservationModel
from belief.validation import Floats


@dataclass(frozen=True)
class RepeatDiscount:
    """Discounts touches in used poses by the correlation ρ of touches in one pose, in [0, 1], or None.

    The weight of the n-th touch is the difference of
    :func:`~belief.observation_model.repeat_discount.effective_touches` for n and n - 1 touches. Without a correlation,
    only the least used poses are allowed (decision 0006).
    """

    correlation: Probability | None = None

    def __post_init__(self) -> None:
        check(self)

    def weights(self, uses: ArrayLike) -> Floats:
        """Value of the next touch in each pose relative to a new touch's, for ``uses (..., P)``; 0 forbids a pose."""
        n, rho = np.asarray(uses, np.float64), self.correlation
        if rho is None:
            return (n == n.min(axis=-1, keepdims=True)).astype(np.float64)
        # The difference of effective_touches at n + 1 and n, without cancellation.
        return np.where(n > 0.0, (1.0 - rho) / ((1.0 + n * rho) * (1.0 + np.maximum(n - 1.0, 0.0) * rho)), 1.0)


LEAST_USED = RepeatDiscount()
"""Allows only the least used poses."""


def weights_in_turn(repeats: RepeatDiscount, num_poses: int, times: int) -> Floats:
    """Weights of an object's first, second, … touch if each of P poses is used ``times`` times in turn, ``(P times,)``.

    >>> weights_in_turn(RepeatDiscount(0.5), 2, 2).round(3).tolist()
    [1.0, 1.0, 0.333, 0.333]
    """
    return np.repeat([repeats.weights(np.full(num_poses, used)).max() for used in range(times)], num_poses)


def repeat_discount(model: ObservationModel | None) -> RepeatDiscount:
    """The discount by the ``repeat_correlation`` of an observation model, if it has one."""
    return RepeatDiscount(getattr(model, "repeat_correlation", None))
