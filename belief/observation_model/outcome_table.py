"""Outcome tables: discrete observation models."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from belief.bayes import expected_information_gain
from belief.frozen import FrozenArrays
from belief.validation import SUM_TOLERANCE, Floats, as_real, renormalised


@dataclass(frozen=True, eq=False)
class OutcomeTable(FrozenArrays):
    """A discrete observation model.

    Attributes:
        probs: p(outcome | pose, shape), ``(P, K, M)``; the last axis sums to one.

    Raises:
        ValueError: not real numbers, not three axes, a negative or NaN entry, or a row that does not sum to one.

    Example:
        >>> table = OutcomeTable(np.array([[[0.9, 0.1], [0.1, 0.9]]]))
        >>> table.num_poses, table.num_shapes, table.num_outcomes
        (1, 2, 2)
        >>> table.information().round(3)                  # at most log 2 = 0.693 nats
        array([0.368])
    """

    probs: Floats

    def __post_init__(self) -> None:
        probs = np.array(as_real(self.probs, "probs"), np.float64)
        if probs.ndim != 3 or probs.size == 0:
            raise ValueError(f"probs must be (P, K, M) with no axis empty, got shape {probs.shape}")
        with np.errstate(over="ignore", invalid="ignore"):
            bad = ~((probs >= 0.0).all(axis=2) & (np.abs(probs.sum(axis=2) - 1.0) <= SUM_TOLERANCE))
        if bad.any():
            pose, shape = (int(i) for i in np.argwhere(bad)[0])
            raise ValueError(
                f"probs[pose {pose}, shape {shape}] is no distribution over outcomes: {probs[pose, shape].tolist()}"
            )
        probs = renormalised(probs)
        probs.flags.writeable = False  # already a copy
        object.__setattr__(self, "probs", probs)

    @property
    def num_poses(self) -> int:
        """P."""
        return self.probs.shape[0]

    @property
    def num_shapes(self) -> int:
        """K."""
        return self.probs.shape[1]

    @property
    def num_outcomes(self) -> int:
        """M."""
        return self.probs.shape[2]

    @property
    def sha256(self) -> str:
        """SHA-256 of the table's shape and numbers."""
        content = np.ascontiguousarray(self.probs, "<f8").tobytes()
        return hashlib.sha256(repr(self.probs.shape).encode() + content).hexdigest()

    def information(self, prior: ArrayLike | None = None) -> Floats:
        """Mutual information of one touch and the shape, in each pose [nats], ``(P,)``; uniform prior by default."""
        belief = np.full(self.num_shapes, 1.0 / self.num_shapes) if prior is None else prior
        return expected_information_gain(belief, self.probs)
