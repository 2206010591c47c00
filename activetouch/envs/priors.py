"""Priors of the shape of a test's object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
TargetProb: TypeAlias = float | tuple[float, float]
"""Prior probability of the target; or a range, from which every test draws its own, uniformly (decision 0024)."""


@dataclass(frozen=True)
class ObjectPriors:
    """Priors that give the target a probability in a range, and equal probabilities to the other K - 1 shapes.

    Raises:
        ValueError: there are fewer than two shapes, or not 0 < low ≤ high < 1.
    """

    num_shapes: int
    low: float
    high: float

    def __post_init__(self) -> None:
        if not (self.num_shapes > 1 and 0.0 < self.low <= self.high < 1.0):
            raise ValueError(
                f"a test needs at least two shapes, and target_prob must be a number or an increasing range in (0, 1); "
                f"got {self.num_shapes} shapes and {self.low}, {self.high}"
            )

    @classmethod
    def of(cls, num_shapes: int, target_prob: TargetProb) -> ObjectPriors:
        """The priors of a probability or a range."""
        ends = np.ravel(np.asarray(target_prob, np.float64)).tolist()
        if len(ends) not in (1, 2):
            raise ValueError(f"target_prob must be a probability or a range (low, high), got {target_prob}")
        return cls(num_shapes, ends[0], ends[-1])

    @property
    def middle(self) -> float:
        """Middle of the range."""
        return (self.low + self.high) / 2.0

    def draw(self, rng: np.random.Generator, number: int) -> Floats:
        """Priors of the target for ``number`` tests, ``(n,)``."""
        if self.low == self.high:
            return np.full(number, self.low)
        return rng.uniform(self.low, self.high, number)

    def probs(self, target_probs: ArrayLike, targets: ArrayLike) -> Floats:
        """Probabilities of all shapes, ``(..., K)``, from the target's, ``(...)``.

        Args:
            target_probs: ``(...)``.
            targets: index of the target, of all tests or of each, ``(...)``.

        Raises:
            ValueError: a probability is not in (0, 1).
        """
        target = np.asarray(target_probs, np.float64)[..., None]
        if not ((target > 0.0) & (target < 1.0)).all():
            raise ValueError(f"the target's probability must be in (0, 1), got {target_probs!r}")
        is_target = np.arange(self.num_shapes) == np.asarray(targets)[..., None]
        return np.where(is_target, target, (1.0 - target) / (self.num_shapes - 1))
