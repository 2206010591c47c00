"""Touch problems with tabular observation models, for solvers.

Both are partially observable Markov decision processes whose hidden state does not change while an object is touched.
A policy decides which observations to buy, and when to stop.

Solvers take a search as a sequence of stages, one per object, with the smallest exact hidden state.
Within a stage the hidden state x does not change, and probes observe the shape of the current object. CONFIRM ends the
search with a payoff that depends on x. REJECT leads to the next stage, where x changes by a stochastic matrix; in the
last stage it ends the search with a payoff. For one object x is its shape. For ``independent`` objects x is the shape
and whether a target was rejected before; for ``distinct`` ones the shape and the set of shapes rejected before: n
2^(n-1) states in all, because the order of rejection does not matter.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from math import comb
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.composition import Composition
from belief.constraints import NOT_NEGATIVE, Within, require_rule
from belief.errors import InvalidArgument
from belief.frozen import FrozenArrays
from belief.naming import shown
from belief.observation_model.outcome_table import OutcomeTable
from belief.validation import MOST_REPEATED, Floats, as_real, normalise_probs, require_count, require_index

MAX_STATES = 2000
_LEAST_LOG = -500.0  # of a probability relative to the largest


class _Tabular:
    outcome_probs: Floats

    @property
    def num_poses(self) -> int:
        """P."""
        return self.outcome_probs.shape[0]

    @property
    def num_shapes(self) -> int:
        """K."""
        return self.outcome_probs.shape[1]


@dataclass(frozen=True, eq=False)
class TouchProblem(_Tabular, FrozenArrays):
    """Decide whether one object is the target (paper §5.8).

    CONFIRM and REJECT end the problem with +1 if right and -1 if wrong; every probe costs ``touch_cost``.

    Attributes:
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        prior: probabilities of the shape, ``(K,)``.
        target: index of the target shape.
        touch_cost: λ, price of a probe, ≥ 0.
        discount: γ, per probe, in (0, 1].

    Example:
        >>> problem = TouchProblem(np.array([[[0.9, 0.1], [0.1, 0.9]]]), prior=[0.5, 0.5], target=0, touch_cost=0.05)
        >>> problem.num_poses, problem.num_shapes
        (1, 2)
    """

    outcome_probs: Floats
    prior: Floats
    target: int
    touch_cost: float
    discount: float = 1.0

    def __post_init__(self) -> None:
        table = checked_table(self.outcome_probs, self.target, self.touch_cost, self.discount)
        object.__setattr__(self, "outcome_probs", table)
        object.__setattr__(self, "prior", distribution(self.prior, table.shape[1], "prior"))
        self.freeze()


@dataclass(frozen=True, eq=False)
class SearchTouchProblem(_Tabular, FrozenArrays):
    """Search for the target among several objects, one after the other, each visited once.

    CONFIRM ends the search with +1 on the target and -1 on any other shape. REJECT gives 0 and brings the next object.
    Rejecting all objects gives +1 if none was the target and -1 otherwise. Every probe costs ``touch_cost``.

    Attributes:
        outcome_probs: p(outcome | pose, shape), ``(P, K, M)``.
        num_objects: N.
        composition: ``distinct``, each shape at most once and all arrangements equally likely, or ``independent``.
        target: index of the shape sought.
        touch_cost: λ, price of a probe, ≥ 0.
        prior: probabilities of the shape of an ``independent`` object, ``(K,)``; uniform by default.
        discount: γ, per probe or REJECT, in (0, 1].
    """

    outcome_probs: Floats
    num_objects: int
    composition: Composition
    target: int
    touch_cost: float
    prior: Floats | None = None
    discount: float = 1.0

    def __post_init__(self) -> None:
        table = checked_table(self.outcome_probs, self.target, self.touch_cost, self.discount)
        num_shapes = table.shape[1]
        object.__setattr__(self, "outcome_probs", table)
        try:
            object.__setattr__(self, "composition", Composition(self.composition))
        except ValueError:
            raise InvalidArgument(
                f"composition must be 'distinct' or 'independent', got {self.composition!r}; the decider "
                "planners.point_based.PointBased also plans for bags of known content"
            ) from None
        require_count("num_objects", self.num_objects, most=MOST_REPEATED)
        if self.composition is Composition.DISTINCT:
            if self.prior is not None:
                raise InvalidArgument("a distinct composition fixes the prior; leave it out or use 'independent'")
            if self.num_objects > num_shapes:
                raise InvalidArgument(
                    f"{self.num_objects} objects cannot all differ in shape, of which there are {num_shapes}"
                )
        prior = np.full(num_shapes, 1.0 / num_shapes) if self.prior is None else self.prior
        object.__setattr__(self, "prior", distribution(prior, num_shapes, "prior"))
        self.freeze()

    @property
    def num_states(self) -> int:
        """Hidden states of all stages together, in the smallest exact form.

        >>> SearchTouchProblem(np.full((1, 4, 1), 1.0), 4, "distinct", target=0, touch_cost=0.1).num_states
        32
        """
        if self.composition is Composition.INDEPENDENT:
            return 2 * self.num_shapes
        return sum(comb(self.num_shapes, i) * (self.num_shapes - i) for i in range(self.num_objects))


def checked_table(outcome_probs: ArrayLike, target: int, touch_cost: float, discount: float) -> Floats:
    """The outcome table ``(P, K, M)`` as float64."""
    table = OutcomeTable(np.asarray(as_real(outcome_probs, "outcome_probs"), np.float64)).probs
    require_index("target", target, table.shape[1])
    require_rule("touch_cost", touch_cost, NOT_NEGATIVE)
    require_rule("discount", discount, Within(0.0, 1.0, open_low=True))
    return table


def require_rounds(rounds: object) -> tuple[int, ...]:
    """Numbers of simulated searches as a tuple; raises InvalidArgument unless there are some, each at least 1.

    >>> require_rounds(number for number in (200, 400))
    (200, 400)
    >>> require_rounds(2)
    Traceback (most recent call last):
    ...
    belief.errors.InvalidArgument: rounds must be one or more integers, each at least 1, such as (200, 400); got 2
    """
    numbers = list(rounds) if isinstance(rounds, Iterable) else []
    if not numbers or any(isinstance(n, bool) or not isinstance(n, Integral) or n < 1 for n in numbers):
        raise InvalidArgument(
            f"rounds must be one or more integers, each at least 1, such as (200, 400); got {shown(rounds)}"
        )
    require_count("the largest number of rounds", max(numbers), most=MOST_REPEATED)
    return tuple(int(n) for n in numbers)


def distribution(probs: ArrayLike, size: int, name: str) -> Floats:
    """A normalised probability vector ``(size,)``."""
    try:
        values = normalise_probs(probs, name)
    except ValueError as error:
        raise InvalidArgument(f"{name} must be {size} probabilities that sum to one: {error}") from error
    if values.shape != (size,):
        raise InvalidArgument(f"{name} must be {size} probabilities that sum to one, got {values.tolist()}")
    return values


@dataclass(frozen=True, eq=False)
class Stage:
    """One object of a search, with n hidden states: its shape and the payoffs of CONFIRM and REJECT in each, ``(n,)``.

    ``moves (n, n')`` are p(state of the next stage | state) after REJECT, which then pays zero; None in the last stage.
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
    """A problem as stages."""
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

    ``shape_probs (N - 1, 2, K)`` are p(shape) of each object but the first if no target was rejected, and if one was.
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
    """Belief about a stage's hidden state, ``(n,)``, from log p(touches of each object | shape), ``(N, K)``."""
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
