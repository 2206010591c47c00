"""Upper bound on the optimal value for one object."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from belief.validation import Floats
from planners.pomdp.problem import Stage, StagedProblem, TouchProblem, staged
from planners.pomdp.solver import point_based_value_iteration, sample_beliefs

from .belief_grid import BeliefGrid
from .touch_costs import TouchCosts

_ROUNDS = (200, 200, 400)  # of planning, to see which beliefs matter
_NUM_SEARCHES = 2000
_EXPLORATION = 0.3
_EXACT_STEPS = 2  # from the belief asked about, so that interpolation enters after as many touches only


class ObjectBound:
    """Upper bounds for one object with some possible shapes, for any payoffs of CONFIRM and REJECT.

    Args:
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        shapes: indices of the possible shapes.
        costs: of touches.
        rng: samples the beliefs around which the grid is fine; any grid gives a valid bound.
    """

    def __init__(
        self, likelihoods: Floats, shapes: NDArray[np.int64], costs: TouchCosts, rng: np.random.Generator
    ) -> None:
        self._shapes, self._costs, self._rng = shapes, costs, rng
        self._likelihoods = likelihoods[:, shapes]
        self._grid: BeliefGrid | None = None

    def __call__(self, belief: Floats, confirm: Floats, reject: Floats) -> float:
        """Upper bound on the value at a belief for payoffs of CONFIRM and REJECT by shape, all ``(K,)``."""
        belief, payoffs = belief[self._shapes], np.stack([confirm, reject])[:, self._shapes]
        known = self._costs.known(payoffs)
        if len(belief) == 1:
            return float(known[0])
        if self._grid is None:
            self._grid = BeliefGrid(self._likelihoods, self._around(belief, payoffs))
        points = self._grid.points

        def stop(beliefs: Floats) -> Floats:
            return np.asarray((beliefs @ payoffs.T).max(axis=1))

        revealed = points @ known
        later = self._costs.after(_EXACT_STEPS)
        values = self._grid.bound(stop(points)[:, None], revealed[:, None], later)[:, 0]
        return look_ahead(self._grid, values, belief, stop, self._likelihoods, self._costs, _EXACT_STEPS)

    def _around(self, belief: Floats, payoffs: Floats) -> Floats:
        """Beliefs that a good policy reaches."""
        stage = Stage(np.arange(len(belief)), payoffs[0], payoffs[1])
        problem = StagedProblem((stage,), belief, self._likelihoods, self._costs.cost, self._costs.discount)
        vectors = point_based_value_iteration(problem, self._rng, _ROUNDS)
        return np.concatenate(sample_beliefs(problem, vectors, self._rng, _NUM_SEARCHES, _EXPLORATION)[0])


def look_ahead(
    grid: BeliefGrid,
    values: Floats,
    belief: Floats,
    stop: Callable[[Floats], Floats],
    likelihoods: Floats,
    costs: TouchCosts,
    steps: int,
) -> float:
    """Upper bound at a belief by some exact steps of look-ahead, with the grid's bound after them.

    Args:
        grid: of beliefs.
        values: bounds at its points after ``steps`` touches, ``(G,)``.
        belief: about the shape, ``(K,)``.
        stop: gives upper bounds on the value of stopping at beliefs ``(B, K)``, ``(B,)``.
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        costs: of touches.
        steps: number of exact steps.
    """

    def bound(beliefs: Floats, touches: int) -> Floats:
        if touches == steps:
            return np.maximum(grid.interpolate(values, beliefs), stop(beliefs))
        weight = costs.weight(touches)
        nothing = (1.0 - weight) * bound(beliefs, touches + 1) if weight < 1.0 else 0.0
        best = stop(beliefs)
        for table in likelihoods:
            joint = np.moveaxis(beliefs[:, :, None] * table, 2, 1)  # (B, M, K)
            chance = joint.sum(axis=2)
            possible = chance > 0.0
            after = np.zeros(chance.shape)
            after[possible] = bound(joint[possible] / chance[possible][:, None], touches + 1)
            shown = weight * (chance * after).sum(axis=1)
            best = np.maximum(best, costs.discount * (shown + nothing) - costs.cost)
        return best

    return float(bound(belief[None], 0)[0])


def object_bound(problem: TouchProblem, rng: np.random.Generator, weights: Sequence[float] = (1.0,)) -> float:
    """Upper bound on the optimal value for one object at the prior.

    Args:
        problem: one object.
        rng: samples the beliefs around which the grid is fine; any grid gives a valid bound.
        weights: probability that each touch gives new information, see :class:`.TouchCosts`.

    With outcomes that are right nine times in ten and λ = 0.05, the best policy touches until the outcomes for one
    shape outnumber those for the other by two: V(0.9) = -λ + 0.82 · 0.976 + 0.18 (V(0.9) - λ), and
    V(0.5) = V(0.9) - λ = 0.8537.

    >>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])
    >>> round(object_bound(TouchProblem(table, [0.5, 0.5], 0, 0.05), np.random.default_rng(0)), 4)
    0.8537
    """
    shapes = np.flatnonzero(problem.prior > 0.0)
    costs = TouchCosts(problem.touch_cost, problem.discount, weights)
    bound = ObjectBound(problem.outcome_probs, shapes, costs, rng)
    stage = staged(problem).stages[0]
    return bound(problem.prior, stage.confirm, stage.reject)
