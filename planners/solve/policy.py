"""Solved problems: what to do at a belief, what that is worth, and how far it can be from the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.problem import Floats
from planners.solve.bounds import touch_bound
from planners.solve.plans import Plans
from planners.solve.point_based import point_based
from planners.solve.problem import SearchTouchProblem, TouchProblem
from planners.solve.search_bounds import search_bound
from planners.solve.stages import staged

_BLOCK = 256  # beliefs whose worth under all plans fits a processor's cache


@dataclass(frozen=True, eq=False)
class TouchPolicy:
    """A policy for one object, with bounds on what the best one is worth at the problem's prior.

    Actions are integers: 0 to P - 1 are poses to probe in, P is CONFIRM, P + 1 is REJECT. Of equally good plans those
    that stop come first, then the lowest pose.

    Attributes:
        problem: what was solved.
        plans: whose value is linear in the belief.
    """

    problem: TouchProblem
    plans: Plans

    def value(self, belief: ArrayLike) -> Floats:
        """What following the policy is worth at beliefs ``(..., K)``, at least; ``(...)``.

        Raises:
            ValueError: a belief is none.
        """
        return np.asarray((self._checked(belief) @ self._transposed).max(axis=-1))

    def action(self, belief: ArrayLike) -> NDArray[np.int64]:
        """What to do at beliefs ``(..., K)``; ``(...)``.

        Of plans worth the same to seven digits, a batch may be given another than a belief alone.

        Raises:
            ValueError: a belief is none; one alone is only looked through for NaN, to save time.
        """
        beliefs = np.asarray(belief, np.float64)
        if beliefs.ndim == 1:
            worth = beliefs @ self._transposed
            if np.isnan(worth[0]):
                raise ValueError(f"a belief holds NaN: {belief!r}")
            return self.plans.actions[worth.argmax()]
        rows = self._checked(beliefs).reshape(-1, self.problem.num_shapes).astype(np.float32)
        best = np.empty(len(rows), np.int64)
        for i in range(0, len(rows), _BLOCK):
            (rows[i : i + _BLOCK] @ self._single).argmax(axis=1, out=best[i : i + _BLOCK])
        return self.plans.actions[best].reshape(beliefs.shape[:-1])

    def q_values(self, belief: ArrayLike) -> Floats:
        """What each action is worth at beliefs ``(..., K)`` if the policy is followed after it, ``(..., P + 2)``.

        Raises:
            ValueError: a belief is none.
        """
        b = self._checked(belief)
        confirm = 2.0 * b[..., self.problem.target] - b.sum(axis=-1)
        joint = b[..., None, :, None] * self.problem.outcome_probs  # (..., P, K, M)
        after = (np.moveaxis(joint, -2, -1) @ self._transposed).max(axis=-1).sum(axis=-1)
        probes = self.problem.discount * after - self.problem.touch_cost
        return np.concatenate([probes, confirm[..., None], -confirm[..., None]], axis=-1)

    def _checked(self, belief: ArrayLike) -> Floats:
        beliefs = np.asarray(belief, np.float64)
        good = (beliefs >= 0.0).all(axis=-1) & (np.abs(beliefs.sum(axis=-1) - 1.0) <= 2e-3)
        if beliefs.shape[-1:] != (self.problem.num_shapes,) or not good.all():
            raise ValueError(
                f"a belief must be {self.problem.num_shapes} probabilities that sum to one, got {belief!r}"
            )
        return beliefs

    @cached_property
    def _transposed(self) -> Floats:
        return np.ascontiguousarray(self.plans.alphas.T)

    @cached_property
    def _single(self) -> NDArray[np.float32]:
        """Which plan is best may be rounded; what it is worth is not."""
        return self._transposed.astype(np.float32)

    @property
    def lower_bound(self) -> float:
        """What following one of the plans from the prior is worth: the optimum is not below it."""
        return float(self.value(self.problem.prior))

    @cached_property
    def upper_bound(self) -> float:
        """What no policy exceeds at the prior; computed when first asked for, in some seconds."""
        return max(touch_bound(self.problem, np.random.default_rng(0)), self.lower_bound)

    def __str__(self) -> str:
        return _told("policy for one object", len(self.plans.alphas), self.lower_bound, self.upper_bound)


@dataclass(frozen=True, eq=False)
class SearchPolicy:
    """A policy for a whole search, as plans for every object, with bounds at the start.

    Attributes:
        problem: what was solved.
        stages: plans for the first object, the second, and so on; over the hidden states of
            :mod:`planners.solve.stages`.
    """

    problem: SearchTouchProblem
    stages: tuple[Plans, ...] = field(repr=False)

    @property
    def initial_value(self) -> float:
        """What the policy is worth at the start, at least."""
        return float(self.stages[0].value(self._initial[None])[0])

    @property
    def initial_action(self) -> int:
        """What it does first; integers as in :class:`TouchPolicy`."""
        return int(self.stages[0].actions[self.stages[0].best(self._initial[None])[0]])

    @property
    def lower_bound(self) -> float:
        """The same as ``initial_value``: the optimum is not below it."""
        return self.initial_value

    @cached_property
    def upper_bound(self) -> float:
        """What no policy exceeds at the start; computed when first asked for, in some seconds."""
        return max(search_bound(self.problem, np.random.default_rng(0)), self.lower_bound)

    def action(self, object_index: int, belief: Floats) -> int:
        """What to do at a belief ``(n,)`` about an object's state: see :func:`planners.solve.stages.stage_belief`."""
        plans = self.stages[object_index]
        return int(plans.actions[plans.best(belief[None])[0]])

    def value(self, object_index: int, belief: Floats) -> float:
        """What the rest of the search is worth at a belief ``(n,)``, at least."""
        return float(self.stages[object_index].value(belief[None])[0])

    @cached_property
    def _initial(self) -> Floats:
        return staged(self.problem).initial

    def __str__(self) -> str:
        number = sum(len(plans.alphas) for plans in self.stages)
        return _told(f"policy for {self.problem.num_objects} objects", number, self.lower_bound, self.upper_bound)


def solve_touch(problem: TouchProblem, rng: np.random.Generator, rounds: Sequence[int]) -> TouchPolicy:
    """See :func:`planners.solve.solve`."""
    return TouchPolicy(problem, point_based(staged(problem), rng, rounds)[0])


def solve_search(problem: SearchTouchProblem, rng: np.random.Generator, rounds: Sequence[int]) -> SearchPolicy:
    """See :func:`planners.solve.solve`."""
    return SearchPolicy(problem, tuple(point_based(staged(problem), rng, rounds)))


def _told(what: str, num_plans: int, low: float, high: float) -> str:
    gap = f"{(high - low) / abs(high):.2%}" if high else "undefined"
    return f"{what}: {num_plans} plans, worth at least {low:.4f}, at most {high:.4f} is possible (gap {gap})"
