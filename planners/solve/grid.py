r"""Certified upper bounds for one object: value iteration on a grid of beliefs (Lovejoy 1991).

The optimal value is convex in the belief, so between points where it is bounded, linear interpolation bounds it too;
value iteration that looks successors up by interpolation, started from full information, decreases towards a bound and
is one at every step. Any grid gives a bound; it is fine only where it matters, around the beliefs searches come to.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from belief.problem import Floats
from planners.solve.simplex import SimplexGrid, num_points
from planners.solve.terms import TouchTerms

_COARSE_POINTS = {2: 1500, 3: 4000}  # by number of shapes, where no finer grid is needed
_MANY_POINTS = 5500
_MAX_SWEEPS = 1000
_TOLERANCE = 3e-6


class BeliefGrid:
    """Beliefs about K shapes, and where probes lead from each.

    Args:
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        around: beliefs ``(B, K)`` to be fine around, for four shapes or more.

    Attributes:
        points: the beliefs, ``(G, K)``.
    """

    def __init__(self, likelihoods: Floats, around: Floats) -> None:
        num_shapes = likelihoods.shape[1]
        limit = _COARSE_POINTS.get(num_shapes, _MANY_POINTS)
        coarse = next(n for n in range(limit, 0, -1) if num_points(n, num_shapes) <= limit)
        levels = [coarse] if num_shapes in _COARSE_POINTS else [coarse, 2 * coarse, 4 * coarse]
        self._grid = SimplexGrid(num_shapes, levels, around)
        self.points = self._grid.points
        self._successors = [self._lead(table) for table in likelihoods]

    def bound(self, stop: Floats, start: Floats, terms: TouchTerms) -> Floats:
        """Bounds of the optimal value at each of the points, for several ways in which stopping may pay; ``(G, B)``.

        Args:
            stop: what stopping is worth at each of the points, at most, ``(G, B)``.
            start: bounds to start from, ``(G, B)``.
            terms: on which the object can be touched.
        """
        value = np.maximum(start, stop)
        cost, discount = terms.lasting
        for _ in range(_MAX_SWEEPS):
            updated = np.minimum(self._backup(value, stop, discount, cost), value)
            change = float((value - updated).max())
            value = updated
            if change < _TOLERANCE:
                break
        for weight in terms.weights[-2::-1]:
            shown, nothing = terms.discount * weight, terms.discount * (1.0 - weight)
            value = self._backup(value, stop, shown, terms.cost - nothing * value)
        return value

    def _backup(self, value: Floats, stop: Floats, discount: float, cost: float | Floats) -> Floats:
        best = stop
        for matrix in self._successors:
            best = np.maximum(best, discount * (matrix @ value) - cost)
        return best

    def interpolate(self, values: Floats, beliefs: Floats) -> Floats:
        """Values between the points, at beliefs ``(B, K)``; ``(B,)``."""
        columns, weights = self._grid.look_up(beliefs)
        return np.asarray((values[columns] * weights).sum(axis=1))

    def _lead(self, table: Floats) -> csr_array:
        """Matrix that turns values at the points into their expectation after a probe, ``(G, G)``."""
        joint = np.moveaxis(self.points[:, :, None] * table, 2, 1)  # (G, M, K)
        chance = joint.sum(axis=2)
        row, outcome = np.nonzero(chance > 0.0)
        columns, weights = self._grid.look_up(joint[row, outcome] / chance[row, outcome][:, None])
        weights *= chance[row, outcome][:, None]
        rows = np.repeat(row, table.shape[0])
        return csr_array((weights.ravel(), (rows, columns.ravel())), shape=(len(self.points),) * 2)
