"""Where the probability of a cell goes when what is hidden moves, and what a cell explains when it is missed a little.

A kernel joins pairs of cells that are near each other. It is symmetric: as much of the prior goes from one cell to
another as comes back, so that a belief that knows nothing still knows nothing after a move.

>>> places = np.array([[0.0], [1.0], [5.0]])
>>> kernel = CellKernel.of(np.exp(-np.square(places - places.T)), np.full(3, 1 / 3))
>>> kernel.moved(np.log([1.0, 1e-9, 1e-9]), 0.5).round(2).tolist()        # half of the probability stays in any case
[-0.14, -2.01, -20.72]
>>> kernel.mean(np.array([0.0, 4.0, 0.0])).round(2).tolist()
[2.74, 3.69, 0.0]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.frozen import FrozenArrays
from belief.validation import Floats

_STEPS = 30  # of the balance of rows and columns
_TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True, eq=False)
class CellKernel(FrozenArrays):
    """Joint probabilities of the cells before and after a move, of N cells: a sparse symmetric matrix.

    Attributes:
        joint: its E entries that are not zero, ``(E,)``, row by row; they sum to 1.
        columns: of each entry, ``(E,)``.
        starts: first entry of each row, and E, ``(N + 1,)``.
        shares: prior probability of each cell, ``(N,)``, which is the sum of its row and of its column.
    """

    joint: Floats
    columns: NDArray[np.int32]
    starts: NDArray[np.int32]
    shares: Floats

    @classmethod
    def of(cls, closeness: Any, shares: Floats) -> CellKernel:
        """The kernel of cells whose pairs are weighed by their closeness.

        Args:
            closeness: ``(N, N)``, symmetric and not negative, zero nowhere on its diagonal; an array or a sparse array.
            shares: prior probabilities of the cells, ``(N,)``, positive.

        Raises:
            ValueError: numbers that are none of these, or rows that cannot be balanced.
        """
        matrix = scipy.sparse.csr_array(closeness, dtype=np.float64)
        if matrix.shape != (len(shares), len(shares)) or not (np.isfinite(shares).all() and np.min(shares) > 0.0):
            raise ValueError(f"closeness must be (N, N) for N positive shares, got {matrix.shape} and {len(shares)}")
        if not (np.isfinite(matrix.data).all() and (matrix.data >= 0.0).all() and (matrix.diagonal() > 0.0).all()):
            raise ValueError("closeness must be finite, nowhere negative, and positive on its diagonal")
        shares = np.asarray(shares, np.float64) / np.sum(shares)
        factors = np.sqrt(shares / (matrix @ np.ones(len(shares))))
        for _ in range(_STEPS):
            factors = np.sqrt(factors * shares / (matrix @ factors))
        rows = np.repeat(np.arange(len(shares)), np.diff(matrix.indptr))
        joint = factors[rows] * matrix.data * factors[matrix.indices]
        return cls(joint, matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32), shares)

    def moved(self, log_weights: Floats, prob: float) -> Floats:
        """Log weights ``(..., N)`` after a move with probability ``prob``; the sums of the weights stay."""
        return self._of_logs(log_weights, self._forward, prob)

    def mean(self, log_likelihoods: NDArray[np.floating]) -> Floats:
        """Log mean likelihood of the cells in which one may be instead of each cell, ``(..., N)``."""
        return self._of_logs(log_likelihoods, self._back, 1.0)

    @staticmethod
    def _of_logs(logs: NDArray[np.floating], matrix: Any, prob: float) -> Floats:
        largest = np.max(logs, axis=-1, keepdims=True)
        largest = np.where(np.isfinite(largest), largest, 0.0)
        weights = np.exp(logs - largest, dtype=np.float64)
        found = (matrix @ weights.reshape(-1, weights.shape[-1]).T).T.reshape(weights.shape)
        found *= prob
        found += (1.0 - prob) * weights
        return np.asarray(np.log(np.maximum(found, _TINY, out=found), out=found) + largest)

    @cached_property
    def _forward(self) -> Any:
        """Sparse ``(N, N)`` that takes probabilities before a move to those after it."""
        return self._matrix(self.joint / self.shares[self.columns])

    @cached_property
    def _back(self) -> Any:
        """Its transpose, which takes likelihoods after a move to those before it."""
        return self._matrix(self.joint / np.repeat(self.shares, np.diff(self.starts)))

    def _matrix(self, entries: Floats) -> Any:
        return scipy.sparse.csr_array((entries, self.columns, self.starts), shape=2 * (len(self.shares),))
