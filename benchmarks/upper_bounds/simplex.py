"""Grids on a simplex, and interpolation between their points by Freudenthal's triangulation."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, combinations
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.validation import Floats

_NEGLIGIBLE = 1e-13
_BLOCK = 4_000_000  # numbers in the largest array


class SimplexGrid:
    """A grid of distributions over K values: all multiples of 1/n, and multiples of 1/2n, 1/4n, … near given ones.

    A distribution is interpolated between the K corners of the finest simplex whose corners are all in the grid.

    Args:
        num_parts: K.
        levels: n, and multiples of it for finer grids.
        around: distributions ``(B, K)`` near which the finer grids have points.

    Attributes:
        points: ``(G, K)``.

    Example:
        >>> grid = SimplexGrid(3, [2], np.empty((0, 3)))
        >>> len(grid.points)
        6
        >>> columns, weights = grid.look_up(np.array([[0.75, 0.25, 0.0]]))
        >>> bool(np.allclose((weights[:, :, None] * grid.points[columns]).sum(axis=1), [[0.75, 0.25, 0.0]]))
        True
    """

    points: Floats

    def __init__(self, num_parts: int, levels: Sequence[int], around: Floats) -> None:
        self._num_parts, self._levels, self._finest = num_parts, tuple(levels), levels[-1]
        counts = [_compositions(levels[0], num_parts) * (self._finest // levels[0])]
        for n in self._levels[1:]:
            for some in _blocks(around):
                corners, weights = _corners(some, n)
                counts.append(np.unique(corners[weights > 0.0], axis=0) * (self._finest // n))
        self._codes, index = np.unique(self._code(np.concatenate(counts)), return_index=True)
        self.points = np.concatenate(counts)[index] / self._finest

    def look_up(self, distributions: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Indices of the corners around each distribution ``(B, K)``, and its weights of them, both ``(B, K)``."""
        found = [self._look_up(some) for some in _blocks(distributions)]
        columns, weights = zip(*found, strict=True)
        return np.concatenate(columns), np.concatenate(weights)

    def _look_up(self, distributions: Floats) -> tuple[NDArray[np.int64], Floats]:
        columns = np.zeros((len(distributions), self._num_parts), np.int64)
        weights = np.zeros((len(distributions), self._num_parts))
        left = np.arange(len(distributions))
        for n in reversed(self._levels):
            corners, shares = _corners(distributions[left], n)
            code = self._code(corners * (self._finest // n))
            at = np.minimum(np.searchsorted(self._codes, code), len(self._codes) - 1)
            there = ((self._codes[at] == code) | (shares == 0.0)).all(axis=1)
            columns[left[there]] = np.where(shares[there] > 0.0, at[there], 0)
            weights[left[there]] = shares[there] / shares[there].sum(axis=1, keepdims=True)
            left = left[~there]
        return columns, weights

    def _code(self, counts: NDArray[np.int64]) -> NDArray[Any]:
        """An integer for each point, or bytes if integers would overflow; the last count follows from the others."""
        if (self._finest + 1) ** (self._num_parts - 1) <= np.iinfo(np.int64).max:
            return np.asarray(counts[..., :-1] @ (self._finest + 1) ** np.arange(self._num_parts - 1))
        letters = np.ascontiguousarray(counts[..., :-1], ">u2")
        return letters.view(f"S{letters.shape[-1] * 2}")[..., 0]


def _blocks(distributions: Floats) -> list[Floats]:
    """The rows ``(B, K)`` in blocks whose corners fit in memory; one block if there are no rows."""
    size = max(1, _BLOCK // distributions.shape[1] ** 2)
    return [distributions[first : first + size] for first in range(0, max(len(distributions), 1), size)]


def num_points(n: int, num_parts: int) -> int:
    """Number of distributions over ``num_parts`` values that are multiples of 1/n.

    >>> num_points(2, 3)
    6
    """
    return comb(n + num_parts - 1, num_parts - 1)


def _corners(distributions: Floats, n: int) -> tuple[NDArray[np.int64], Floats]:
    """Corners around each distribution, in multiples of 1/n, ``(B, K, K)``, and its weights of them, ``(B, K)``."""
    num_parts = distributions.shape[1]
    # Cumulative sums from the right map the simplex to 0 ≤ x_K ≤ … ≤ x_1 = n, the domain of Freudenthal's cubes.
    x = n * np.cumsum(distributions[:, ::-1], axis=1)[:, ::-1]
    x[:, 0] = n
    base = np.floor(np.minimum(x, n) + 1e-12).astype(np.int64)
    rest = np.clip(x - base, 0.0, 1.0)
    order = np.argsort(-rest, axis=1, kind="stable")
    sorted_rest = np.take_along_axis(rest, order, axis=1)
    rank = np.argsort(order, axis=1)
    # Corner j takes a step along the j axes with the largest remainders.
    corners = base[:, None] + (rank[:, None, :] < np.arange(num_parts)[None, :, None])
    weights = np.empty((len(distributions), num_parts))
    weights[:, 0] = 1.0 - sorted_rest[:, 0]
    weights[:, 1:] = sorted_rest[:, :-1] - sorted_rest[:, 1:]
    counts = -np.diff(corners, axis=2, append=0)
    return counts, np.where(weights > _NEGLIGIBLE, weights, 0.0)


def _compositions(n: int, num_parts: int) -> NDArray[np.int64]:
    """All ordered tuples of ``num_parts`` integers ≥ 0 with sum n, ``(C, num_parts)``."""
    flat = chain.from_iterable(combinations(range(n + num_parts - 1), num_parts - 1))
    size = num_points(n, num_parts)
    bars = np.fromiter(flat, np.int64, size * (num_parts - 1)).reshape(size, num_parts - 1)  # stars and bars
    return np.diff(bars, axis=1, prepend=-1, append=n + num_parts - 1) - 1
