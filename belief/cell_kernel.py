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
    """Joint probabilities of the wide cells before and after a move, and the N cells that lie in them.

    Within a wide cell, what has moved there is spread over its cells by their prior. Of M wide cells, the joint
    probabilities are a sparse symmetric matrix.

    Attributes:
        joint: its E entries that are not zero, ``(E,)``, row by row; they sum to 1.
        columns: of each entry, ``(E,)``.
        starts: first entry of each row, and E, ``(M + 1,)``.
        shares: prior probability of each wide cell, ``(M,)``, the sum of its row and of its column.
        wide: the wide cell of each cell, ``(N,)``; empty where each is one of its own.
        parts: prior probability of each cell, as a part of its wide cell's, ``(N,)``; empty as well.
    """

    joint: Floats
    columns: NDArray[np.int32]
    starts: NDArray[np.int32]
    shares: Floats
    wide: NDArray[np.int64]
    parts: Floats

    @classmethod
    def of(cls, closeness: Any, shares: Floats, wide: NDArray[np.int64] | None = None) -> CellKernel:
        """The kernel of cells whose pairs are weighed by their closeness.

        Args:
            closeness: of wide cells, ``(M, M)``, symmetric and not negative, zero nowhere on its diagonal; an array or
                a sparse array.
            shares: prior probabilities of the cells, ``(N,)``, positive.
            wide: the wide cell of each cell, ``(N,)``, in which all M occur; by default each is one of its own.

        Raises:
            ValueError: numbers that are none of these.
        """
        matrix, shares = scipy.sparse.csr_array(closeness, dtype=np.float64), np.asarray(shares, np.float64)
        if not (shares.ndim == 1 and np.isfinite(shares).all() and shares.min(initial=1.0) > 0.0):
            raise ValueError(f"shares must be (N,), positive and finite, got {shares!r:.80}")
        shares = shares / shares.sum()
        within, parts = np.zeros(0, np.int64), np.zeros(0)
        if wide is not None:
            within = np.asarray(wide, np.int64)
            of_wide = np.asarray(np.bincount(within, shares, matrix.shape[0]), np.float64)
            parts, shares = shares / of_wide[within], of_wide
        if matrix.shape != 2 * (len(shares),) or not shares.min() > 0.0:
            raise ValueError(f"closeness must be (M, M) for the M wide cells, got {matrix.shape} and {len(shares)}")
        if not (np.isfinite(matrix.data).all() and (matrix.data >= 0.0).all() and (matrix.diagonal() > 0.0).all()):
            raise ValueError("closeness must be finite, nowhere negative, and positive on its diagonal")
        factors = np.sqrt(shares / (matrix @ np.ones(len(shares))))
        for _ in range(_STEPS):
            factors = np.sqrt(factors * shares / (matrix @ factors))
        rows = np.repeat(np.arange(len(shares)), np.diff(matrix.indptr))
        joint = factors[rows] * matrix.data * factors[matrix.indices]
        return cls(joint, matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32), shares, within, parts)

    @property
    def num_cells(self) -> int:
        """N."""
        return len(self.wide) or len(self.shares)

    @property
    def fingerprint(self) -> float:
        """A number that differs between kernels: the sum of squared joint probabilities."""
        return float(np.square(self.joint).sum())

    def moved(self, log_weights: Floats, prob: float) -> Floats:
        """Log weights ``(..., N)`` after a move with probability ``prob``; the sums of the weights stay."""
        weights, largest = _weights(log_weights)
        return _logs(prob * self.spread(weights) + (1.0 - prob) * weights, largest)

    def spread(self, weights: Floats) -> Floats:
        """Weights ``(..., N)`` after a move."""
        found = self._of_cells(_product(self._forward, self._pooled(weights)))
        return found * self.parts if len(self.wide) else found

    def mean(self, log_likelihoods: NDArray[np.floating]) -> Floats:
        """Log mean likelihood of the cells in which one may be instead of each cell, ``(..., N)``."""
        weights, largest = _weights(log_likelihoods)
        weights = weights * self.parts if len(self.wide) else weights
        return _logs(self._of_cells(_product(self._back, self._pooled(weights))), largest)

    def _pooled(self, weights: Floats) -> Floats:
        """Sums over the cells of each wide cell, ``(..., M)``."""
        if not len(self.wide):
            return weights
        return np.asarray(np.add.reduceat(np.take(weights, self._order, axis=-1), self._firsts, axis=-1))

    def _of_cells(self, found: Floats) -> Floats:
        return np.take(found, self.wide, axis=-1) if len(self.wide) else found

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        """The cells by their wide cells, ``(N,)``."""
        return np.argsort(self.wide, kind="stable")

    @cached_property
    def _firsts(self) -> NDArray[np.int64]:
        """First cell of each wide cell in that order, ``(M,)``."""
        return np.searchsorted(self.wide[self._order], np.arange(len(self.shares)))

    @cached_property
    def _forward(self) -> Any:
        """Sparse ``(M, M)`` that takes probabilities before a move to those after it."""
        return self._matrix(self.joint / self.shares[self.columns])

    @cached_property
    def _back(self) -> Any:
        """Its transpose, which takes likelihoods after a move to those before it."""
        return self._matrix(self.joint / np.repeat(self.shares, np.diff(self.starts)))

    def _matrix(self, entries: Floats) -> Any:
        return scipy.sparse.csr_array((entries, self.columns, self.starts), shape=2 * (len(self.shares),))


def _weights(logs: NDArray[np.floating]) -> tuple[Floats, Floats]:
    """Exponentials relative to the largest, ``(..., N)``, and the log of the largest, ``(..., 1)``."""
    largest = np.max(logs, axis=-1, keepdims=True)
    largest = np.where(np.isfinite(largest), largest, 0.0)
    return np.exp(np.subtract(logs, largest, dtype=np.float64)), largest


def _logs(weights: Floats, largest: Floats) -> Floats:
    return np.asarray(np.log(np.maximum(weights, _TINY)) + largest)


def _product(matrix: Any, weights: Floats) -> Floats:
    rows = weights.reshape(-1, weights.shape[-1])
    return np.ascontiguousarray((matrix @ rows.T).T).reshape(*weights.shape[:-1], -1)
