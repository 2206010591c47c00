"""What no policy for one object can exceed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from belief.problem import Floats
from planners.bounds.belief_grid import BeliefGrid
from planners.pomdp.belief_sampling import reached_beliefs
from planners.pomdp.problem import TouchProblem
from planners.pomdp.solver import point_based
from planners.pomdp.stages import Stage, StagedProblem, staged
from planners.pomdp.touch_costs import TouchTerms

_ROUNDS = (200, 200, 400)  # of planning, to see which beliefs matter
_NUM_SEARCHES = 2000
_EXPLORATION = 0.3
_EXACT_STEPS = 2  # from the belief asked about, so that interpolation enters after as many touches only


class ObjectBound:
    """Upper bounds for one object whose shape is among some, whatever it pays to stop.

    Args:
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        shapes: indices of those it can have.
        terms: on which it can be touched.
        rng: samples where the grid is fine; any grid gives a bound.
    """

    def __init__(
        self, likelihoods: Floats, shapes: NDArray[np.int64], terms: TouchTerms, rng: np.random.Generator
    ) -> None:
        self._shapes, self._terms, self._rng = shapes, terms, rng
        self._likelihoods = likelihoods[:, shapes]
        self._grid: BeliefGrid | None = None

    def __call__(self, belief: Floats, confirm: Floats, reject: Floats) -> float:
        """A number that no policy is worth more than at a belief; all by shape, ``(K,)``."""
        belief, payoffs = belief[self._shapes], np.stack([confirm, reject])[:, self._shapes]
        if len(belief) == 1:
            return float(payoffs.max())
        if self._grid is None:
            self._grid = BeliefGrid(self._likelihoods, self._around(belief, payoffs))
        points = self._grid.points

        def stop(beliefs: Floats) -> Floats:
            return np.asarray((beliefs @ payoffs.T).max(axis=1))

        told = points @ payoffs.max(axis=0)
        later = self._terms.after(_EXACT_STEPS)
        values = self._grid.bound(stop(points)[:, None], told[:, None], later)[:, 0]
        return look_ahead(self._grid, values, belief, stop, self._likelihoods, self._terms, _EXACT_STEPS)

    def _around(self, belief: Floats, payoffs: Floats) -> Floats:
        """Beliefs that good policies come to."""
        stage = Stage(np.arange(len(belief)), payoffs[0], payoffs[1])
        problem = StagedProblem((stage,), belief, self._likelihoods, self._terms.cost, self._terms.discount)
        plans = point_based(problem, self._rng, _ROUNDS)
        return np.concatenate(reached_beliefs(problem, plans, self._rng, _NUM_SEARCHES, _EXPLORATION)[0])


def look_ahead(
    grid: BeliefGrid,
    values: Floats,
    belief: Floats,
    stop: Callable[[Floats], Floats],
    likelihoods: Floats,
    terms: TouchTerms,
    steps: int,
) -> float:
    """Upper bound at a belief by so many exact steps, and the grid's after them.

    Args:
        grid: with ``values`` at its points, once so many touches were made, ``(G,)``.
        values: see ``grid``.
        belief: ``(K,)``.
        stop: what stopping is worth at beliefs ``(B, K)``, at most, ``(B,)``.
        likelihoods: p(outcome | pose, shape), ``(P, K, M)``.
        terms: on which the object can be touched.
        steps: how many.
    """

    def bound(beliefs: Floats, touches: int) -> Floats:
        if touches == steps:
            return np.maximum(grid.interpolate(values, beliefs), stop(beliefs))
        weight = terms.weight(touches)
        nothing = (1.0 - weight) * bound(beliefs, touches + 1) if weight < 1.0 else 0.0
        best = stop(beliefs)
        for table in likelihoods:
            joint = np.moveaxis(beliefs[:, :, None] * table, 2, 1)  # (B, M, K)
            chance = joint.sum(axis=2)
            possible = chance > 0.0
            worth = np.zeros(chance.shape)
            worth[possible] = bound(joint[possible] / chance[possible][:, None], touches + 1)
            shown = weight * (chance * worth).sum(axis=1)
            best = np.maximum(best, terms.discount * (shown + nothing) - terms.cost)
        return best

    return float(bound(belief[None], 0)[0])


def touch_bound(problem: TouchProblem, rng: np.random.Generator, weights: Sequence[float] = (1.0,)) -> float:
    """What no policy for one object exceeds at the prior.

    Args:
        problem: the test.
        rng: samples where the grid is fine; any grid gives a bound.
        weights: what each touch is worth, see :class:`~planners.pomdp.touch_costs.TouchTerms`.

    Right nine times of ten, at λ = 0.05, the best is to touch until one more outcome points one way than the other, and
    then twice more: V(.9) = -λ + .82 · .976 + .18 (V(.9) - λ), and V(.5) = V(.9) - λ = 0.8537 by hand.

    >>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])
    >>> round(touch_bound(TouchProblem(table, [0.5, 0.5], 0, 0.05), np.random.default_rng(0)), 4)
    0.8537
    """
    shapes = np.flatnonzero(problem.prior > 0.0)
    terms = TouchTerms(problem.touch_cost, problem.discount, weights)
    bound = ObjectBound(problem.outcome_probs, shapes, terms, rng)
    stage = staged(problem).stages[0]
    return bound(problem.prior, stage.confirm, stage.reject)
