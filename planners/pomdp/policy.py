"""Policies of solved problems: the best action at a belief, its value, and bounds on the optimal value."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.categorical import Belief
from belief.errors import InvalidArgument
from belief.validation import Floats, normalise_probs, require_index
from planners.pomdp.problem import SearchTouchProblem, TouchProblem
from planners.pomdp.solver import AlphaVectors
from planners.pomdp.stages import StagedProblem, stage_belief, staged
from planners.pomdp.upper_bound import upper_bound


@dataclass(frozen=True, eq=False)
class TouchPolicy:
    """A policy for one object, with bounds on the optimal value at the problem's prior.

    Actions are integers: 0 to P - 1 are poses to probe in, P is CONFIRM, P + 1 is REJECT. Of equally good actions
    CONFIRM comes first, then REJECT.

    Attributes:
        problem: the problem that was solved.
        vectors: the alpha vectors of the policy.
    """

    problem: TouchProblem
    vectors: AlphaVectors

    def value(self, belief: ArrayLike | Belief) -> Floats:
        """Lower bound on the value of following the policy from beliefs ``(..., K)``; ``(...)``.

        Raises:
            InvalidArgument: a belief is not a distribution over the shapes.
        """
        return np.asarray((_checked(belief, self.problem.num_shapes) @ self.vectors.alphas.T).max(axis=-1))

    def action(self, belief: ArrayLike | Belief) -> NDArray[np.int64]:
        """The best action at beliefs ``(..., K)``; ``(...)``.

        Raises:
            InvalidArgument: a belief is not a distribution over the shapes.
        """
        beliefs = _checked(belief, self.problem.num_shapes)
        return self.vectors.actions[(beliefs @ self.vectors.alphas.T).argmax(axis=-1)]

    def q_values(self, belief: ArrayLike | Belief) -> Floats:
        """Value of each action at beliefs ``(..., K)`` if the policy is followed after it, ``(..., P + 2)``.

        Raises:
            InvalidArgument: a belief is not a distribution over the shapes.
        """
        b = _checked(belief, self.problem.num_shapes)
        confirm = 2.0 * b[..., self.problem.target] - b.sum(axis=-1)
        joint = b[..., None, :, None] * self.problem.outcome_probs  # (..., P, K, M)
        after = (np.moveaxis(joint, -2, -1) @ self.vectors.alphas.T).max(axis=-1).sum(axis=-1)
        probes = self.problem.discount * after - self.problem.touch_cost
        return np.concatenate([probes, confirm[..., None], -confirm[..., None]], axis=-1)

    @property
    def lower_bound(self) -> float:
        """Lower bound on the optimal value at the prior: the value of the policy."""
        return float(self.value(self.problem.prior))

    @cached_property
    def upper_bound(self) -> float:
        """Upper bound on the optimal value at the prior; computed when first asked for, in some seconds."""
        return max(upper_bound(self.problem), self.lower_bound)

    def __str__(self) -> str:
        return _summary("policy for one object", len(self.vectors.alphas), self.lower_bound, self.upper_bound)


@dataclass(frozen=True, eq=False)
class SearchPolicy:
    """A policy for a whole search, with bounds on the optimal value at its start.

    A policy that is not repeat-aware has one set of alpha vectors per object. A repeat-aware one has a set for each
    number of touches that the object has had; the last set holds for all numbers beyond.

    Attributes:
        problem: the problem that was solved.
        vectors: alpha vectors by object and by number of touches, over the hidden states of
            :mod:`planners.pomdp.stages`.
    """

    problem: SearchTouchProblem | StagedProblem
    vectors: tuple[tuple[AlphaVectors, ...], ...] = field(repr=False)

    @cached_property
    def search(self) -> StagedProblem:
        """The problem as stages."""
        return self.problem if isinstance(self.problem, StagedProblem) else staged(self.problem)

    def at(self, object_index: int, num_touches: int = 0) -> AlphaVectors:
        """The alpha vectors for an object that has had so many touches.

        Raises:
            InvalidArgument: there is no such object.
        """
        require_index("object_index", object_index, len(self.vectors))
        by_touches = self.vectors[object_index]
        return by_touches[min(num_touches, len(by_touches) - 1)]

    def belief(self, object_index: int, log_likelihoods: Floats) -> Floats:
        """Belief about the hidden state at an object; see :func:`planners.pomdp.stages.stage_belief`."""
        return stage_belief(self.search, log_likelihoods, object_index)

    def probe_values(
        self,
        object_index: int,
        belief: Floats,
        num_touches: int,
        weights: Floats,
        outcome_probs: NDArray[np.floating] | None = None,
    ) -> Floats:
        """Value of one more touch in each pose, by one exact step of look-ahead, ``(P,)``.

        ``weights (P,)`` are the probabilities that a touch gives new information; the value is -inf for weight zero.
        ``outcome_probs``, p(outcome | pose, shape) ``(P, K, M)``, are those of the next touch given the ones before; by
        default those of the problem. ``belief (n,)`` is about the hidden state after ``num_touches`` touches.
        """
        after, table = self.at(object_index, num_touches + 1), self.search.outcome_probs
        probs = (table if outcome_probs is None else outcome_probs)[:, self.search.stages[object_index].shapes]
        joint = np.moveaxis(belief[:, None] * probs, 2, 1)  # (P, M, n)
        informed = (joint @ after.alphas.T).max(axis=2).sum(axis=1)
        repeated = float((after.alphas @ belief).max())
        values = self.search.discount * (weights * informed + (1.0 - weights) * repeated) - self.search.touch_cost
        return np.where(weights > 0.0, values, -np.inf)

    @property
    def initial_value(self) -> float:
        """Lower bound on the value of the policy at the start."""
        return float(self.at(0).value(self.search.initial[None])[0])

    @property
    def lower_bound(self) -> float:
        """Lower bound on the optimal value at the start: ``initial_value``."""
        return self.initial_value

    @cached_property
    def upper_bound(self) -> float:
        """Upper bound on the optimal value at the start; computed when first asked for, in some seconds.

        Raises:
            InvalidArgument: the problem was given as stages, for which there is no bound.
        """
        if isinstance(self.problem, StagedProblem):
            raise InvalidArgument("an upper bound needs a SearchTouchProblem; this policy was solved for stages")
        return max(upper_bound(self.problem), self.lower_bound)

    def __str__(self) -> str:
        number = sum(len(vectors.alphas) for by_touches in self.vectors for vectors in by_touches)
        high = None if isinstance(self.problem, StagedProblem) else self.upper_bound
        return _summary(f"policy for {len(self.vectors)} objects", number, self.lower_bound, high)


def _checked(belief: ArrayLike | Belief, num_states: int) -> Floats:
    """Beliefs ``(..., num_states)`` as float64."""
    wanted = f"a belief must be {num_states} probabilities"
    try:
        beliefs = normalise_probs(belief.probs if isinstance(belief, Belief) else belief, "a belief")
    except ValueError as error:
        raise InvalidArgument(f"{wanted} that sum to one: {error}") from error
    if beliefs.shape[-1] != num_states:
        raise InvalidArgument(f"{wanted}, got {beliefs.shape[-1]}")
    return beliefs


def _summary(what: str, num_vectors: int, low: float, high: float | None) -> str:
    if high is None:
        return f"{what}: {num_vectors} alpha vectors, value at least {low:.4f}"
    gap = f"{(high - low) / abs(high):.2%}" if high else "undefined"
    return f"{what}: {num_vectors} alpha vectors, value at least {low:.4f}, at most {high:.4f} is possible (gap {gap})"
