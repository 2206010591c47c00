"""A search as a sequence of stages, one per object, with the smallest exact hidden state.

Within a stage the hidden state x does not change, and probes observe the shape of the current object. CONFIRM ends the
search with a payoff that depends on x. REJECT leads to the next stage, where x changes by a stochastic matrix; in the
last stage it ends the search with a payoff. For one object x is its shape. For ``independent`` objects x is the shape
and whether a target was rejected before; for ``distinct`` ones the shape and the set of shapes rejected before: n
2^(n-1) states in all, because the order of rejection does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from belief.composition import Composition
from belief.errors import InvalidArgument
from belief.validation import Floats
from planners.pomdp.problem import SearchTouchProblem, TouchProblem

MAX_STATES = 2000
_LEAST_LOG = -500.0  # of a probability relative to the largest


@dataclass(frozen=True, eq=False)
class Stage:
    """One object of a search.

    Attributes:
        shapes: shape of the current object in each of the n states, ``(n,)``.
        confirm: payoff of CONFIRM, ``(n,)``.
        reject: payoff of REJECT, ``(n,)``; zero if there is a next stage.
        moves: p(state of the next stage | state) after REJECT, ``(n, n')``; None in the last stage.
    """

    shapes: NDArray[np.int64]
    confirm: Floats
    reject: Floats
    moves: Floats | None = None


@dataclass(frozen=True, eq=False)
class StagedProblem:
    """A search as stages, in the form that the solver takes.

    Attributes:
        stages: one per object.
        initial: belief about the first stage's state.
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        touch_cost: λ.
        discount: γ, per probe or REJECT.
    """

    stages: tuple[Stage, ...]
    initial: Floats
    outcome_probs: Floats
    touch_cost: float
    discount: float

    def likelihoods(self, stage: int) -> Floats:
        """p(outcome | pose, state), ``(P, n, M)``."""
        return self.outcome_probs[:, self.stages[stage].shapes]


def staged(problem: TouchProblem | SearchTouchProblem) -> StagedProblem:
    """A problem as stages.

    Raises:
        InvalidArgument: there would be more than 2 000 states.
    """
    if isinstance(problem, TouchProblem):
        is_target = np.arange(problem.num_shapes) == problem.target
        stage = Stage(np.arange(problem.num_shapes), _sign(is_target), _sign(~is_target))
        stages, initial = [stage], problem.prior
    elif problem.composition is Composition.DISTINCT:
        stages, initial = _distinct(problem)
    else:
        prior = problem.prior
        assert prior is not None, "set at construction"
        later = np.broadcast_to(prior, (problem.num_objects - 1, 2, problem.num_shapes))
        stages = stages_by_missed(problem.num_shapes, problem.target, later)
        initial = np.concatenate([prior, 0.0 * prior])
    return StagedProblem(tuple(stages), initial, problem.outcome_probs, problem.touch_cost, problem.discount)


def stages_by_missed(num_shapes: int, target: int, shape_probs: Floats) -> list[Stage]:
    """Stages with 2K states: the shape of the current object without a rejected target, then with one.

    ``shape_probs``, ``(N - 1, 2, K)``, has for each object but the first the distributions over its shape if no target
    was rejected before, and if one was.
    """
    shapes = np.tile(np.arange(num_shapes), 2)
    is_target = shapes == target
    missed = is_target | (np.arange(2 * num_shapes) >= num_shapes)  # after this object is rejected
    stages = []
    for without, after in shape_probs:
        moves = np.zeros((2 * num_shapes, 2 * num_shapes))
        moves[~missed, :num_shapes] = without
        moves[missed, num_shapes:] = after
        stages.append(Stage(shapes, _sign(is_target), np.zeros(2 * num_shapes), moves))
    return [*stages, Stage(shapes, _sign(is_target), _sign(~missed))]


def _distinct(problem: SearchTouchProblem) -> tuple[list[Stage], Floats]:
    num_shapes, every = problem.num_shapes, range(problem.num_shapes)
    total = problem.num_states
    if total > MAX_STATES:
        raise InvalidArgument(
            f"{problem.num_objects} distinct objects of {num_shapes} shapes have {total} hidden states, more than "
            f"{MAX_STATES}; the decider planners.point_based.PointBased plans for fewer states, without bounds"
        )
    sets = [[sum(1 << shape for shape in gone) for gone in combinations(every, i)] for i in range(problem.num_objects)]
    states = [
        np.array([(gone, shape) for gone in some for shape in every if not (gone >> shape) & 1], np.int64).T
        for some in sets  # of rejected shapes, as bits
    ]
    stages = []
    for i, (gone, shapes) in enumerate(states):
        is_target = shapes == problem.target
        if i + 1 == problem.num_objects:
            lost = is_target | ((gone >> problem.target) & 1).astype(np.bool_)
            stages.append(Stage(shapes, _sign(is_target), _sign(~lost)))
        else:
            moves = ((gone | (1 << shapes))[:, None] == states[i + 1][0]).astype(np.float64)
            moves /= moves.sum(axis=1, keepdims=True)
            stages.append(Stage(shapes, _sign(is_target), np.zeros(len(shapes)), moves))
    return stages, np.full(num_shapes, 1.0 / num_shapes)


def _sign(right: NDArray[np.bool_]) -> Floats:
    return np.where(right, 1.0, -1.0)


def stage_belief(problem: StagedProblem, log_likelihoods: Floats, number: int) -> Floats:
    """Belief about a stage's hidden state, given the touches of its object and of those rejected before, ``(n,)``.

    ``log_likelihoods``, log p(touches of an object | shape), are ``(N, K)``; finite or -inf.
    """
    belief = problem.initial
    for i in range(number + 1):
        with np.errstate(divide="ignore"):
            logs = np.log(belief) + log_likelihoods[i, problem.stages[i].shapes]
        relative = logs - logs.max()
        # Possible states keep a positive probability, so that later evidence can raise it.
        belief = np.where(relative == -np.inf, 0.0, np.exp(np.maximum(relative, _LEAST_LOG)))
        belief /= belief.sum()
        if i < number:
            moves = problem.stages[i].moves
            assert moves is not None, "only the last stage has no successor"
            belief = belief @ moves
    return belief
