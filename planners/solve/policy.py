"""Solved problems: what to do at a belief, what that is worth, and how far it can be from the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.errors import InvalidArgument
from belief.problem import Floats
from belief.validation import SUM_TOLERANCE, as_real
from planners.bounds.object import touch_bound
from planners.bounds.search import search_bound
from planners.pomdp.alpha_vectors import Plans
from planners.pomdp.problem import SearchTouchProblem, TouchProblem
from planners.pomdp.solver import point_based
from planners.pomdp.stages import staged

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
            InvalidArgument: a belief is none.
        """
        return np.asarray((checked_beliefs(belief, self.problem.num_shapes) @ self._transposed).max(axis=-1))

    def action(self, belief: ArrayLike) -> NDArray[np.int64]:
        """What to do at beliefs ``(..., K)``; ``(...)``.

        Of plans worth the same to seven digits, a batch may be given another than a belief alone.

        Raises:
            InvalidArgument: a belief is none.
        """
        beliefs = checked_beliefs(belief, self.problem.num_shapes)
        if beliefs.ndim == 1:
            return self.plans.actions[(beliefs @ self._transposed).argmax()]
        rows = beliefs.reshape(-1, self.problem.num_shapes).astype(np.float32)
        best = np.empty(len(rows), np.int64)
        for i in range(0, len(rows), _BLOCK):
            (rows[i : i + _BLOCK] @ self._single).argmax(axis=1, out=best[i : i + _BLOCK])
        return self.plans.actions[best].reshape(beliefs.shape[:-1])

    def q_values(self, belief: ArrayLike) -> Floats:
        """What each action is worth at beliefs ``(..., K)`` if the policy is followed after it, ``(..., P + 2)``.

        Raises:
            InvalidArgument: a belief is none.
        """
        b = checked_beliefs(belief, self.problem.num_shapes)
        confirm = 2.0 * b[..., self.problem.target] - b.sum(axis=-1)
        joint = b[..., None, :, None] * self.problem.outcome_probs  # (..., P, K, M)
        after = (np.moveaxis(joint, -2, -1) @ self._transposed).max(axis=-1).sum(axis=-1)
        probes = self.problem.discount * after - self.problem.touch_cost
        return np.concatenate([probes, confirm[..., None], -confirm[..., None]], axis=-1)

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
            :mod:`planners.pomdp.stages`.
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

    def action(self, object_index: int, belief: ArrayLike) -> int:
        """What to do at a belief ``(n,)`` about an object's state: see :func:`planners.pomdp.stages.stage_belief`.

        Raises:
            InvalidArgument: there is no such object, or the belief is none.
        """
        plans, beliefs = self._stage(object_index, belief)
        return int(plans.actions[plans.best(beliefs)[0]])

    def value(self, object_index: int, belief: ArrayLike) -> float:
        """What the rest of the search is worth at a belief ``(n,)``, at least; errors as of :meth:`action`."""
        plans, beliefs = self._stage(object_index, belief)
        return float(plans.value(beliefs)[0])

    def _stage(self, object_index: int, belief: ArrayLike) -> tuple[Plans, Floats]:
        """The plans for an object, and a belief about its state as one row."""
        if not isinstance(object_index, Integral) or not 0 <= object_index < len(self.stages):
            raise InvalidArgument(f"object_index must be in [0, {len(self.stages)}), got {object_index!r}")
        plans = self.stages[object_index]
        checked = checked_beliefs(belief, plans.alphas.shape[1])
        if checked.ndim != 1:
            raise InvalidArgument(f"one belief ({plans.alphas.shape[1]},) is needed, got {checked.shape}")
        return plans, checked[None]

    @cached_property
    def _initial(self) -> Floats:
        return staged(self.problem).initial

    def __str__(self) -> str:
        number = sum(len(plans.alphas) for plans in self.stages)
        return _told(f"policy for {self.problem.num_objects} objects", number, self.lower_bound, self.upper_bound)


def checked_beliefs(belief: ArrayLike, num_states: int) -> Floats:
    """Beliefs ``(..., n)`` as float64.

    Raises:
        InvalidArgument: another number of states, text, negative numbers, NaN, infinity, or a sum that is not one
            within float16's rounding.

    >>> checked_beliefs([0.7, 0.7], 2)
    Traceback (most recent call last):
    ...
    belief.errors.InvalidArgument: a belief must be 2 probabilities that sum to one, got [0.7, 0.7]
    """
    try:
        beliefs = np.asarray(as_real(belief, "a belief"), np.float64)
    except ValueError as error:
        raise InvalidArgument(f"a belief must be {num_states} probabilities that sum to one: {error}") from error
    if beliefs.shape[-1:] == (num_states,):
        if beliefs.ndim == 1:  # one decision must not wait for a check of many
            row = beliefs.tolist()
            good = abs(sum(row) - 1.0) <= SUM_TOLERANCE and min(row) >= 0.0  # NaN fails
        else:
            good = bool((beliefs >= 0.0).all() and (np.abs(beliefs.sum(axis=-1) - 1.0) <= SUM_TOLERANCE).all())
        if good:
            return beliefs
    raise InvalidArgument(f"a belief must be {num_states} probabilities that sum to one, got {belief!r}")


def solve_touch(problem: TouchProblem, rng: np.random.Generator, rounds: Sequence[int]) -> TouchPolicy:
    """See :func:`planners.solve.solve`."""
    return TouchPolicy(problem, point_based(staged(problem), rng, rounds)[0])


def solve_search(problem: SearchTouchProblem, rng: np.random.Generator, rounds: Sequence[int]) -> SearchPolicy:
    """See :func:`planners.solve.solve`."""
    return SearchPolicy(problem, tuple(point_based(staged(problem), rng, rounds)))


def _told(what: str, num_plans: int, low: float, high: float) -> str:
    gap = f"{(high - low) / abs(high):.2%}" if high else "undefined"
    return f"{what}: {num_plans} plans, worth at least {low:.4f}, at most {high:.4f} is possible (gap {gap})"
