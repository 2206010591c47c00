"""A search written out as stages, one an object, with the smallest hidden state that is exact.

In a stage the hidden state x stays as it is while probes observe the shape of the current object. CONFIRM ends
everything with a payoff that depends on x; REJECT leads to the next stage, x moving by a stochastic matrix, or, in the
last stage, ends with a payoff. For one object x is its shape. For ``independent`` objects x is the shape and whether a
target was rejected before; for ``distinct`` ones the shape and the set of shapes rejected before: n 2^(n-1) states in
all, because it does not matter in which order they went.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

from belief import Composition
from belief.problem import Floats
from planners.pomdp.problem import SearchTouchProblem, TouchProblem

MAX_STATES = 2000
_LEAST_LOG = -500.0  # of a probability relative to the largest


@dataclass(frozen=True, eq=False)
class Stage:
    """One object.

    Attributes:
        shapes: of the current object in each of the n states, ``(n,)``.
        confirm: payoff of CONFIRM, ``(n,)``.
        reject: payoff of REJECT, ``(n,)``; zero where it leads on.
        moves: states of the next stage after REJECT, ``(n, n')``, rows sum to one; None in the last stage.
    """

    shapes: NDArray[np.int64]
    confirm: Floats
    reject: Floats
    moves: Floats | None = None


@dataclass(frozen=True, eq=False)
class StagedProblem:
    """All that a solver needs.

    Attributes:
        stages: one an object.
        initial: belief about the first stage's state.
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        touch_cost: λ.
        discount: γ, a probe or a REJECT.
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
        ValueError: there would be more than 2 000 states.
    """
    if isinstance(problem, TouchProblem):
        is_target = np.arange(problem.num_shapes) == problem.target
        stage = Stage(np.arange(problem.num_shapes), _sign(is_target), _sign(~is_target))
        stages, initial = [stage], problem.prior
    elif problem.composition is Composition.DISTINCT:
        stages, initial = _distinct(problem)
    else:
        stages, initial = _independent(problem)
    return StagedProblem(tuple(stages), initial, problem.outcome_probs, problem.touch_cost, problem.discount)


def num_states(problem: TouchProblem | SearchTouchProblem) -> int:
    """Hidden states of all stages together, in the smallest exact form.

    >>> import numpy as np
    >>> from planners.solve import SearchTouchProblem
    >>> num_states(SearchTouchProblem(np.full((1, 4, 1), 1.0), 4, "distinct", target=0, touch_cost=0.1))
    32
    """
    if isinstance(problem, TouchProblem):
        return problem.num_shapes
    if problem.composition is Composition.INDEPENDENT:
        return 2 * problem.num_shapes
    return sum(comb(problem.num_shapes, i) * (problem.num_shapes - i) for i in range(problem.num_objects))


def _independent(problem: SearchTouchProblem) -> tuple[list[Stage], Floats]:
    num_shapes, prior = problem.num_shapes, problem.prior
    assert prior is not None, "filled in at construction"
    shapes = np.tile(np.arange(num_shapes), 2)  # nothing missed yet, then a target missed
    missed = np.arange(2 * num_shapes) >= num_shapes
    is_target = shapes == problem.target
    moves = np.zeros((2 * num_shapes, 2 * num_shapes))
    moves[~(missed | is_target), :num_shapes] = prior
    moves[missed | is_target, num_shapes:] = prior
    nothing = np.zeros(2 * num_shapes)
    going_on = Stage(shapes, _sign(is_target), nothing, moves)
    last = Stage(shapes, _sign(is_target), _sign(~(missed | is_target)))
    return [going_on] * (problem.num_objects - 1) + [last], np.concatenate([prior, 0.0 * prior])


def _distinct(problem: SearchTouchProblem) -> tuple[list[Stage], Floats]:
    num_shapes, every = problem.num_shapes, range(problem.num_shapes)
    total = num_states(problem)
    if total > MAX_STATES:
        raise ValueError(
            f"{problem.num_objects} distinct objects of {num_shapes} shapes have {total} hidden states, more than "
            f"{MAX_STATES}; the decider planners.point_based.PointBased plans for fewer states, without bounds"
        )
    states = [
        [(gone, shape) for gone in combinations(every, i) for shape in every if shape not in gone]
        for i in range(problem.num_objects)
    ]
    stages = []
    for i, here in enumerate(states):
        shapes = np.array([shape for _, shape in here])
        is_target = shapes == problem.target
        if i + 1 == problem.num_objects:
            lost = np.array([problem.target in gone for gone, _ in here]) | is_target
            stages.append(Stage(shapes, _sign(is_target), _sign(~lost)))
            continue
        index = {state: number for number, state in enumerate(states[i + 1])}
        moves = np.zeros((len(here), len(index)))
        for row, (gone, shape) in enumerate(here):
            rejected = tuple(sorted((*gone, shape)))
            left = [other for other in every if other not in rejected]
            moves[row, [index[rejected, other] for other in left]] = 1.0 / len(left)
        stages.append(Stage(shapes, _sign(is_target), np.zeros(len(here)), moves))
    return stages, np.full(num_shapes, 1.0 / num_shapes)


def _sign(right: NDArray[np.bool_]) -> Floats:
    return np.where(right, 1.0, -1.0)


def stage_belief(problem: StagedProblem, log_likelihoods: Floats, number: int) -> Floats:
    """Belief about a stage's hidden state, given what was felt of its object and of those rejected before, ``(n,)``.

    Args:
        problem: the search.
        log_likelihoods: log p(touches of an object | shape), ``(N, K)``; any size.
        number: of the stage, from 0.

    >>> import numpy as np
    >>> from planners.solve import SearchTouchProblem
    >>> problem = staged(SearchTouchProblem(np.full((1, 2, 1), 1.0), 2, "distinct", target=0, touch_cost=0.1))
    >>> stage_belief(problem, np.log([[0.2, 0.8], [0.5, 0.5]]), 1)      # probably the target is still to come
    array([0.2, 0.8])
    >>> problem.stages[1].shapes
    array([1, 0])
    """
    belief = problem.initial
    for i in range(number + 1):
        with np.errstate(divide="ignore"):
            logs = np.log(belief) + log_likelihoods[i, problem.stages[i].shapes]
        relative = logs - logs.max()
        # What is possible stays possible: later evidence may bring it back.
        belief = np.where(relative == -np.inf, 0.0, np.exp(np.maximum(relative, _LEAST_LOG)))
        belief /= belief.sum()
        if i < number:
            moves = problem.stages[i].moves
            assert moves is not None, "only the last stage leads nowhere"
            belief = belief @ moves
    return belief
