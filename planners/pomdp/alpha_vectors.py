"""Alpha vectors: a value function as the maximum of linear functions of the belief."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief.validation import Floats


@dataclass(frozen=True, eq=False)
class AlphaVectors:
    """Alpha vectors of one stage with the action that each begins with; the value at a belief b is max α·b.

    Attributes:
        alphas: the vectors over hidden states, ``(A, n)``.
        actions: first action of each, ``(A,)``: a pose, P for CONFIRM, P + 1 for REJECT.
    """

    alphas: Floats
    actions: NDArray[np.int64]

    def best(self, beliefs: Floats) -> NDArray[np.int64]:
        """Index of the best vector at each belief ``(B, n)``; the first of equally good ones."""
        return np.asarray((beliefs @ self.alphas.T).argmax(axis=1))

    def value(self, beliefs: Floats) -> Floats:
        """Value at each belief ``(B, n)``, normalised or not, ``(B,)``."""
        return np.asarray((beliefs @ self.alphas.T).max(axis=1))

    def useful(self, beliefs: Floats) -> AlphaVectors:
        """Only the vectors that are best at one of the beliefs ``(B, n)``."""
        kept = np.unique(self.best(beliefs))
        return AlphaVectors(self.alphas[kept], self.actions[kept])

    def joined(self, other: AlphaVectors) -> AlphaVectors:
        """These vectors, followed by the others."""
        return AlphaVectors(np.concatenate([self.alphas, other.alphas]), np.concatenate([self.actions, other.actions]))
