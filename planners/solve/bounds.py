"""What no policy can exceed, for one object and for a search."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from belief import Composition
from belief.problem import Floats
from planners.solve.grid import BeliefGrid
from planners.solve.point_based import point_based
from planners.solve.problem import SearchTouchProblem, TouchProblem
from planners.solve.reached import reached_beliefs
from planners.solve.stages import Stage, StagedProblem, staged

_ROUNDS = (200, 200, 400)  # of planning, to see which beliefs matter
_NUM_SEARCHES = 2000
_EXPLORATION = 0.3
_EXACT_STEPS = 2  # from the belief asked about, so that interpolation enters after as many touches only


class ObjectBound:
    """Upper bounds for one object whose shape is among some, whatever it pays to stop.

    Args:
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        shapes: indices of those it can have.
        touch_cost: λ.
        discount: γ.
        rng: samples where the grid is fine; any grid gives a bound.
    """

    def __init__(
        self,
        likelihoods: Floats,
        shapes: NDArray[np.int64],
        touch_cost: float,
        discount: float,
        rng: np.random.Generator,
    ) -> None:
        self._shapes, self._touch_cost, self._discount, self._rng = shapes, touch_cost, discount, rng
        self._likelihoods = likelihoods[:, shapes]
        self._grid: BeliefGrid | None = None

    def __call__(self, belief: Floats, confirm: Floats, reject: Floats) -> float:
        """A number that no policy is worth more than at a belief; all by shape, ``(K,)``."""
        belief, stops = belief[self._shapes], np.stack([confirm, reject])[:, self._shapes]
        if len(belief) == 1:
            return float(stops.max())
        if self._grid is None:
            self._grid = BeliefGrid(self._likelihoods, self._around(belief, stops))
        values = self._grid.bound(stops, self._touch_cost, self._discount)
        return float(self._look_ahead(self._grid, values, belief[None], stops, _EXACT_STEPS)[0])

    def _around(self, belief: Floats, stops: Floats) -> Floats:
        """Beliefs that good policies come to."""
        stage = Stage(np.arange(len(belief)), stops[0], stops[1])
        problem = StagedProblem((stage,), belief, self._likelihoods, self._touch_cost, self._discount)
        plans = point_based(problem, self._rng, _ROUNDS)
        return np.concatenate(reached_beliefs(problem, plans, self._rng, _NUM_SEARCHES, _EXPLORATION)[0])

    def _look_ahead(self, grid: BeliefGrid, values: Floats, beliefs: Floats, stops: Floats, steps: int) -> Floats:
        """Upper bound at beliefs ``(B, K)`` by so many exact steps and the grid after them, ``(B,)``."""
        if steps == 0:
            return grid.interpolate(values, beliefs)
        best = np.asarray((beliefs @ stops.T).max(axis=1))
        for table in self._likelihoods:
            joint = np.moveaxis(beliefs[:, :, None] * table, 2, 1)  # (B, M, K)
            chance = joint.sum(axis=2)
            possible = chance > 0.0
            after = joint[possible] / chance[possible][:, None]
            worth = np.zeros(chance.shape)
            worth[possible] = self._look_ahead(grid, values, after, stops, steps - 1)
            best = np.maximum(best, self._discount * (chance * worth).sum(axis=1) - self._touch_cost)
        return best


def touch_bound(problem: TouchProblem, rng: np.random.Generator) -> float:
    """What no policy for one object exceeds at the prior.

    Right nine times of ten, at λ = 0.05, the best is to touch until one more outcome points one way than the other, and
    then twice more: V(.9) = -λ + .82 · .976 + .18 (V(.9) - λ), and V(.5) = V(.9) - λ = 0.8537 by hand.

    >>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])
    >>> round(touch_bound(TouchProblem(table, [0.5, 0.5], 0, 0.05), np.random.default_rng(0)), 4)
    0.8537
    """
    shapes = np.flatnonzero(problem.prior > 0.0)
    bound = ObjectBound(problem.outcome_probs, shapes, problem.touch_cost, problem.discount, rng)
    stage = staged(problem).stages[0]
    return bound(problem.prior, stage.confirm, stage.reject)


def search_bound(problem: SearchTouchProblem, rng: np.random.Generator) -> float:
    """What no policy for a search exceeds: the value of one that is told the shape of every object it rejects.

    Args:
        problem: the search; the bound takes a grid for every set of shapes that can be left.
        rng: see :class:`ObjectBound`.
    """
    num_shapes, target, prior = problem.num_shapes, problem.target, problem.prior
    assert prior is not None, "filled in at construction"
    confirm = np.where(np.arange(num_shapes) == target, 1.0, -1.0)
    distinct = problem.composition is Composition.DISTINCT

    @cache
    def bound_for(shapes: tuple[int, ...]) -> ObjectBound:
        table, cost = problem.outcome_probs, problem.touch_cost
        return ObjectBound(table, np.array(shapes), cost, problem.discount, rng)

    @cache
    def value(number: int, gone: frozenset[int]) -> float:
        """Of the objects from this number on; ``gone`` are the shapes rejected before, as far as they matter."""
        missed = target in gone
        if number == problem.num_objects:
            return -1.0 if missed else 1.0
        belief = np.where(np.isin(np.arange(num_shapes), list(gone)), 0.0, 1.0) if distinct else prior.copy()
        belief /= belief.sum()
        reject = np.full(num_shapes, -1.0)
        for shape in np.flatnonzero(belief > 0.0).tolist():
            matters = distinct or shape == target
            reject[shape] = value(number + 1, gone | {shape} if matters else gone)
        if number + 1 < problem.num_objects:
            reject *= problem.discount
        if (confirm == -1.0)[belief > 0.0].all() and (reject[belief > 0.0] == -1.0).all():
            return -1.0  # lost, whatever is done
        return bound_for(tuple(np.flatnonzero(belief > 0.0).tolist()))(belief, confirm, reject)

    return value(0, frozenset())
