r"""Certified upper bounds for one object: value iteration on a grid of beliefs (Lovejoy 1991).

The optimal value is convex in the belief, so linear interpolation between upper bounds gives an upper bound. Value
iteration that interpolates at the successors of each point starts from the value under full information and decreases;
every iterate is an upper bound. Any grid gives a valid bound; this one is fine around the beliefs that searches reach.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, vstack

from belief.errors import InvalidArgument
from belief.validation import Floats

from .simplex import SimplexGrid, num_points
from .touch_costs import TouchCosts

_COARSE_POINTS = {2: 1500, 3: 4000}  # by number of shapes, where no finer grid is needed
_MANY_POINTS = 5500
_MOST_REFINED = 16  # shapes; a finer grid of more has more points than memory holds
_MAX_SWEEPS = 1000
_TOLERANCE = 3e-6
_MOST_NUMBERS = 120_000_000
"""Most numbers in all matrices together, about 1.5 GB; the grid is made coarser until they fit."""
_BLOCK = 4_000_000  # numbers in the largest array that a matrix is made from


class BeliefGrid:
    """Grid of beliefs about K shapes, with the successors of each point after every probe.

    Args:
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        around: beliefs ``(B, K)`` around which the grid is fine, for four shapes or more.

    Attributes:
        points: the beliefs, ``(G, K)``.
    """

    def __init__(self, likelihoods: Floats, around: Floats) -> None:
        num_shapes = likelihoods.shape[1]
        limit = _COARSE_POINTS.get(num_shapes, _MANY_POINTS)
        coarse = next(n for n in range(limit, 0, -1) if num_points(n, num_shapes) <= limit)
        levels = (
            [coarse] if num_shapes in _COARSE_POINTS or num_shapes > _MOST_REFINED else [coarse, 2 * coarse, 4 * coarse]
        )
        self._grid = SimplexGrid(num_shapes, levels, around)
        numbers = likelihoods.size  # that each point adds to the matrices
        while len(self._grid.points) * numbers > _MOST_NUMBERS and len(around):
            around = around[1::2]  # any grid gives a valid bound; this one is coarser
            self._grid = SimplexGrid(num_shapes, levels, around)
        self.points = self._grid.points
        if len(self.points) * numbers > _MOST_NUMBERS:
            raise InvalidArgument(
                f"a bound for {likelihoods.shape[0]} poses, {num_shapes} shapes and {likelihoods.shape[2]} outcomes "
                f"needs {len(self.points) * numbers} numbers even on the coarsest grid, more than {_MOST_NUMBERS}; "
                "ask for fewer outcomes, or for fewer shapes"
            )
        self._successors = [self._lead(table) for table in likelihoods]

    def bound(self, stop: Floats, start: Floats, costs: TouchCosts) -> Floats:
        """Upper bounds on the optimal value at each point, for B payoffs of stopping, ``(G, B)``.

        ``stop`` are upper bounds on the value of stopping, and ``start`` are initial bounds, both ``(G, B)``.
        """
        stop = np.maximum(stop, costs.for_ever)  # also where no touch shows anything
        value = np.maximum(start, stop)
        cost, discount = costs.lasting
        for _ in range(_MAX_SWEEPS):
            updated = np.minimum(self._backup(value, stop, discount, cost), value)
            change = float((value - updated).max())
            value = updated
            if change < _TOLERANCE:
                break
        for weight in costs.weights[-2::-1]:
            shown, nothing = costs.discount * weight, costs.discount * (1.0 - weight)
            value = self._backup(value, stop, shown, costs.cost - nothing * value)
        return value

    def _backup(self, value: Floats, stop: Floats, discount: float, cost: float | Floats) -> Floats:
        best = stop
        for matrix in self._successors:
            best = np.maximum(best, discount * (matrix @ value) - cost)
        return best

    def interpolate(self, values: Floats, beliefs: Floats) -> Floats:
        """Interpolated values at beliefs ``(B, K)``; ``(B,)``."""
        columns, weights = self._grid.look_up(beliefs)
        return np.asarray((values[columns] * weights).sum(axis=1))

    def _lead(self, table: Floats) -> csr_array:
        """Matrix that turns values at the points into their expectation after a probe, ``(G, G)``."""
        size = max(1, _BLOCK // table.size)
        parts = [self._lead_from(self.points[i : i + size], table) for i in range(0, len(self.points), size)]
        return csr_array(vstack(parts, format="csr"))

    def _lead_from(self, points: Floats, table: Floats) -> csr_array:
        """The rows of some of the points."""
        joint = np.moveaxis(points[:, :, None] * table, 2, 1)  # (B, M, K)
        chance = joint.sum(axis=2)
        row, outcome = np.nonzero(chance > 0.0)
        columns, weights = self._grid.look_up(joint[row, outcome] / chance[row, outcome][:, None])
        weights *= chance[row, outcome][:, None]
        rows = np.repeat(row, table.shape[0])
        return csr_array((weights.ravel(), (rows, columns.ravel())), shape=(len(points), len(self.points)))
