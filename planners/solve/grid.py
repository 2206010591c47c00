r"""Certified upper bounds for one object: value iteration on a grid of beliefs (Lovejoy 1991).

The optimal value is convex in the belief, so between points where it is bounded, linear interpolation bounds it too;
value iteration that looks successors up by interpolation, started from full information, decreases towards a bound and
is one at every step. Interpolation is by Freudenthal's triangulation: K corners a belief, whatever the dimension.

The grid is fine only where it matters. A coarse one, with spacing 1/n, covers all beliefs; around the beliefs that
searches come to there are the corners of grids with spacing 1/2n and 1/4n, too. A belief is interpolated on the finest
grid of which all its corners are there: any interpolation between bounds is a bound, the finest is the tightest.
"""

from __future__ import annotations

from itertools import chain, combinations
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from belief.problem import Floats

_COARSE_POINTS = {2: 1500, 3: 4000}  # by number of shapes, where no finer grid is needed
_MANY_POINTS = 5500
_MAX_SWEEPS = 1000
_TOLERANCE = 1e-6
_NEGLIGIBLE = 1e-13


class BeliefGrid:
    """Beliefs about K shapes, and where probes lead from each.

    Args:
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        around: beliefs ``(B, K)`` to be fine around, for four shapes or more.
    """

    def __init__(self, likelihoods: Floats, around: Floats) -> None:
        self._num_shapes = num_shapes = likelihoods.shape[1]
        limit = _COARSE_POINTS.get(num_shapes, _MANY_POINTS)
        coarse = next(n for n in range(limit, 0, -1) if comb(n + num_shapes - 1, num_shapes - 1) <= limit)
        self._levels = (coarse,) if num_shapes in _COARSE_POINTS else (coarse, 2 * coarse, 4 * coarse)
        finest = self._levels[-1]
        counts = [_compositions(coarse, num_shapes) * (finest // coarse)]
        for n in self._levels[1:]:
            corners, weights = _corners(around, n)
            counts.append(corners[weights > 0.0] * (finest // n))
        self._finest = finest
        self._codes, index = np.unique(self._code(np.concatenate(counts)), return_index=True)
        self.points = np.concatenate(counts)[index] / finest
        self._successors = [self._lead(table) for table in likelihoods]

    def bound(self, stops: Floats, touch_cost: float, discount: float) -> Floats:
        """A bound of the optimal value at each of the points.

        Args:
            stops: payoff of each way to stop, by shape, ``(A, K)``.
            touch_cost: λ.
            discount: γ.
        """
        stop = (self.points @ stops.T).max(axis=1)
        value = np.maximum(self.points @ stops.max(axis=0), stop)  # of being told the shape for nothing
        for _ in range(_MAX_SWEEPS):
            updated = stop.copy()
            for matrix in self._successors:
                np.maximum(updated, discount * (matrix @ value) - touch_cost, out=updated)
            np.minimum(updated, value, out=updated)
            change = float((value - updated).max())
            value = updated
            if change < _TOLERANCE:
                break
        return value

    def interpolate(self, values: Floats, beliefs: Floats) -> Floats:
        """Values between the points, at beliefs ``(B, K)``; ``(B,)``."""
        columns, weights = self._look_up(beliefs)
        return np.asarray((values[columns] * weights).sum(axis=1))

    def _lead(self, table: Floats) -> csr_array:
        """Matrix that turns values at the points into their expectation after a probe, ``(G, G)``."""
        joint = np.moveaxis(self.points[:, :, None] * table, 2, 1)  # (G, M, K)
        chance = joint.sum(axis=2)
        row, outcome = np.nonzero(chance > 0.0)
        columns, weights = self._look_up(joint[row, outcome] / chance[row, outcome][:, None])
        weights *= chance[row, outcome][:, None]
        rows = np.repeat(row, self._num_shapes)
        return csr_array((weights.ravel(), (rows, columns.ravel())), shape=(len(self.points),) * 2)

    def _look_up(self, beliefs: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Points ``(B, K)`` around each belief, and the weights of which it is the mean."""
        columns = np.zeros((len(beliefs), self._num_shapes), np.int64)
        weights = np.zeros((len(beliefs), self._num_shapes))
        left = np.arange(len(beliefs))
        for n in reversed(self._levels):
            corners, shares = _corners(beliefs[left], n)
            code = self._code(corners * (self._finest // n))
            at = np.minimum(np.searchsorted(self._codes, code), len(self._codes) - 1)
            there = ((self._codes[at] == code) | (shares == 0.0)).all(axis=1)
            columns[left[there]] = np.where(shares[there] > 0.0, at[there], 0)
            weights[left[there]] = shares[there] / shares[there].sum(axis=1, keepdims=True)
            left = left[~there]
        return columns, weights

    def _code(self, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        """One number for each point; the last count follows from the others."""
        return np.asarray(counts[..., :-1] @ (self._finest + 1) ** np.arange(self._num_shapes - 1))


def _corners(beliefs: Floats, n: int) -> tuple[NDArray[np.int64], Floats]:
    """Multiples of 1/n around each belief, as counts ``(B, K, K)``, and their weights in it, ``(B, K)``."""
    num_shapes = beliefs.shape[1]
    # Sums from the right turn the simplex into 0 ≤ x_K ≤ … ≤ x_1 = n, in which Freudenthal's cubes are sorted.
    x = n * np.cumsum(beliefs[:, ::-1], axis=1)[:, ::-1]
    x[:, 0] = n
    base = np.floor(np.minimum(x, n) + 1e-12).astype(np.int64)
    rest = np.clip(x - base, 0.0, 1.0)
    order = np.argsort(-rest, axis=1, kind="stable")
    sorted_rest = np.take_along_axis(rest, order, axis=1)
    rank = np.argsort(order, axis=1)
    # Corner j has stepped along the j axes of largest rest; the first axis, whose rest is zero, is never needed.
    corners = base[:, None] + (rank[:, None, :] < np.arange(num_shapes)[None, :, None])
    weights = np.empty((len(beliefs), num_shapes))
    weights[:, 0] = 1.0 - sorted_rest[:, 0]
    weights[:, 1:] = sorted_rest[:, :-1] - sorted_rest[:, 1:]
    counts = -np.diff(corners, axis=2, append=0)
    return counts, np.where(weights > _NEGLIGIBLE, weights, 0.0)


def _compositions(n: int, num_parts: int) -> NDArray[np.int64]:
    """All ways to write n as an ordered sum of so many numbers ≥ 0, ``(C, num_parts)``."""
    size = comb(n + num_parts - 1, num_parts - 1)
    flat = chain.from_iterable(combinations(range(n + num_parts - 1), num_parts - 1))
    bars = np.fromiter(flat, np.int64, size * (num_parts - 1)).reshape(size, -1)  # stars and bars
    return np.diff(bars, axis=1, prepend=-1, append=n + num_parts - 1) - 1
