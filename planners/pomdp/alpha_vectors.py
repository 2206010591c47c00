"""Plans: what a solver finds, and a policy chooses from at every belief."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief.problem import Floats


@dataclass(frozen=True, eq=False)
class Plans:
    """Plans for one stage: the value of each in each hidden state, and how it begins.

    A plan is worth α·b at the belief b, the best of several max α·b.

    Attributes:
        alphas: value of each plan in each state, ``(A, n)``.
        actions: first action of each, ``(A,)``: a pose, P for CONFIRM, P + 1 for REJECT.

    Example:
        >>> plans = Plans(np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([1, 2]))
        >>> plans.value(np.array([[0.9, 0.1]])).round(3), plans.actions[plans.best(np.array([[0.1, 0.9]]))]
        (array([0.8]), array([2]))
    """

    alphas: Floats
    actions: NDArray[np.int64]

    def best(self, beliefs: Floats) -> NDArray[np.int64]:
        """Index of the best plan at each belief ``(B, n)``; the first of equally good ones."""
        return np.asarray((beliefs @ self.alphas.T).argmax(axis=1))

    def value(self, beliefs: Floats) -> Floats:
        """What the best plan is worth at each belief ``(B, n)``, normalised or not, ``(B,)``."""
        return np.asarray((beliefs @ self.alphas.T).max(axis=1))

    def useful(self, beliefs: Floats) -> Plans:
        """Only the plans that are best at one of the beliefs ``(B, n)``."""
        kept = np.unique(self.best(beliefs))
        return Plans(self.alphas[kept], self.actions[kept])

    def joined(self, other: Plans) -> Plans:
        """These plans, then those."""
        return Plans(np.concatenate([self.alphas, other.alphas]), np.concatenate([self.actions, other.actions]))
