"""Solve touch problems: policies with a lower and an upper bound on the optimal value.

>>> import numpy as np
>>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])                       # one pose, right nine times in ten
>>> policy = solve(TouchProblem(table, prior=[0.5, 0.5], target=0, touch_cost=0.05))
>>> int(policy.action([0.5, 0.5])), int(policy.action([0.99, 0.01])), int(policy.action([0.01, 0.99]))
(0, 1, 2)
>>> bool(policy.lower_bound <= policy.upper_bound < policy.lower_bound + 1e-3)
True
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from math import comb, log
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.bayes import Belief
from belief.composition import Composition
from belief.errors import InvalidArgument
from belief.naming import Name, index_of
from belief.problem import SearchProblem
from belief.validation import Floats, as_real, normalise_probs, require_count, require_index
from planners.point_based_solver import AlphaVectors, point_based_value_iteration, repeat_aware_vectors
from planners.touch_problem import SearchTouchProblem, StagedProblem, TouchProblem, require_rounds, stage_belief, staged

_MOST_BRANCHES = 2_000_000  # of the exact look-ahead, which decide how many touches it has
_MOST_TOUCHES = 20
_MOST_SETS = 5000  # of distinct shapes that rejected objects can have
_PRECISION = 1e-6  # a branch that can change the bound by less is not followed
_AT_ONCE = 2_000_000  # numbers in the largest array


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
        """Upper bound on the optimal value at the prior; computed at first use, in some seconds."""
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
            :mod:`planners.touch_problem`.
    """

    problem: SearchTouchProblem | StagedProblem
    vectors: tuple[tuple[AlphaVectors, ...], ...] = field(repr=False)

    @cached_property
    def search(self) -> StagedProblem:
        """The problem as stages."""
        return self.problem if isinstance(self.problem, StagedProblem) else staged(self.problem)

    def at(self, object_index: int, num_touches: int = 0) -> AlphaVectors:
        """The alpha vectors for an object after ``num_touches`` touches.

        Raises:
            InvalidArgument: there is no such object.
        """
        require_index("object_index", object_index, len(self.vectors))
        by_touches = self.vectors[object_index]
        return by_touches[min(num_touches, len(by_touches) - 1)]

    def belief(self, object_index: int, log_likelihoods: Floats) -> Floats:
        """Belief about the hidden state at an object; see :func:`planners.touch_problem.stage_belief`."""
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
        """Upper bound on the optimal value at the start; computed at first use, in some seconds.

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


def upper_bound(problem: TouchProblem | SearchTouchProblem) -> float:
    """Upper bound on the optimal value at the start, in some seconds.

    For a few touches of an object it looks ahead exactly: all poses, all outcomes. Afterwards it takes the larger of
    stopping and of one more touch that reveals the shape, which no touch exceeds. The shape of every rejected object is
    revealed too. So it is an information relaxation: a searcher who learns more can only do better. It is valid for any
    number of exact touches and falls with it.

    With one pose that is right nine times in ten, the optimal value is 0.8537:

    >>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])
    >>> round(upper_bound(TouchProblem(table, [0.5, 0.5], target=0, touch_cost=0.05)), 4)
    0.8537
    """
    confirm = np.where(np.arange(problem.num_shapes) == problem.target, 1.0, -1.0)
    if isinstance(problem, TouchProblem):
        return _of_object(problem, problem.prior, np.stack([confirm, -confirm]))
    distinct = problem.composition is Composition.DISTINCT
    if distinct and problem.num_states > _MOST_SETS * problem.num_shapes:
        raise InvalidArgument(
            f"a bound for {problem.num_objects} distinct objects of {problem.num_shapes} shapes needs too many sets of "
            f"rejected shapes, more than {_MOST_SETS}; ask for fewer shapes or objects"
        )

    @cache
    def value(number: int, gone: frozenset[int]) -> float:
        """Bound after ``number`` rejected objects, by the set of their shapes that matter."""
        if number == problem.num_objects:
            return -1.0 if problem.target in gone else 1.0
        assert problem.prior is not None, "filled in at construction"
        left = np.isin(np.arange(problem.num_shapes), list(gone), invert=True)
        belief = left / left.sum() if distinct else problem.prior
        reject = np.full(problem.num_shapes, -1.0)
        for shape in np.flatnonzero(belief > 0.0).tolist():
            matters = distinct or shape == problem.target
            reject[shape] = value(number + 1, gone | {shape} if matters else gone)
        if number + 1 < problem.num_objects:
            reject *= problem.discount
        return _of_object(problem, belief, np.stack([confirm, reject]))

    if not distinct:  # there may be many objects: from the last one on, so that no recursion is deep
        for number in range(problem.num_objects - 1, 0, -1):
            value(number, frozenset())
            value(number, frozenset({problem.target}))
    return value(0, frozenset())


def _of_object(problem: TouchProblem | SearchTouchProblem, belief: Floats, payoffs: Floats) -> float:
    """Bound for one object at a belief ``(K,)``, with payoffs of CONFIRM and REJECT by shape ``(2, K)``."""
    shapes = np.flatnonzero(belief > 0.0)
    payoffs = payoffs[:, shapes]
    cost, discount = problem.touch_cost, problem.discount
    for_ever = -cost / (1.0 - discount) if discount < 1.0 else -np.inf  # touching without end postpones a failure
    known = np.maximum(payoffs.max(axis=0), for_ever)
    if len(shapes) == 1:
        return float(known[0])
    table = problem.outcome_probs[:, shapes].swapaxes(1, 2)  # (P, M, K)
    branches = max(table.shape[0] * table.shape[1], 2)
    touches = min(int(log(_MOST_BRANCHES) / log(branches)), _MOST_TOUCHES)

    def bound(beliefs: Floats, reach: Floats, left: int) -> Floats:
        """Bound at beliefs ``(B, k)`` reached with probabilities ``(B,)``, with ``left`` exact touches left."""
        stop = np.maximum((beliefs @ payoffs.T).max(axis=1), for_ever)
        found = np.maximum(stop, discount * (beliefs @ known) - cost)
        matters = np.flatnonzero(reach * (found - stop) > _PRECISION)
        size = max(1, _AT_ONCE // table.size)
        for some in np.split(matters, range(size, len(matters), size)) if left and len(matters) else ():
            joint = beliefs[some, None, None] * table  # (b, P, M, k)
            chance = joint.sum(axis=3)
            after = (joint / np.maximum(chance, np.finfo(float).tiny)[..., None]).reshape(-1, len(shapes))
            reached = (reach[some, None, None] * chance).ravel()
            shown = (chance * bound(after, reached, left - 1).reshape(chance.shape)).sum(axis=2).max(axis=1)
            found[some] = np.minimum(found[some], np.maximum(stop[some], discount * shown - cost))
        return np.asarray(found)

    return float(bound(belief[None, shapes], np.ones(1), touches)[0])


__all__ = [
    "SearchPolicy",
    "SearchTouchProblem",
    "StagedProblem",
    "TouchPolicy",
    "TouchProblem",
    "finite_horizon_value",
    "solve",
]


ROUNDS = (200, 200, 400, 400, 800)
"""Default number of simulated tests of one object per round of planning; takes well below a second for four shapes."""
SEARCH_ROUNDS = (*ROUNDS, 2000)
"""Default number of simulated searches per round of planning; takes one to three seconds for four objects."""


@overload
def solve(
    problem: TouchProblem, rng: np.random.Generator | None = None, rounds: Sequence[int] | None = None
) -> TouchPolicy: ...
@overload
def solve(
    problem: SearchTouchProblem | StagedProblem,
    rng: np.random.Generator | None = None,
    rounds: Sequence[int] | None = None,
    repeat_weights: Floats | None = None,
) -> SearchPolicy: ...
def solve(
    problem: TouchProblem | SearchTouchProblem | StagedProblem,
    rng: np.random.Generator | None = None,
    rounds: Sequence[int] | None = None,
    repeat_weights: Floats | None = None,
) -> TouchPolicy | SearchPolicy:
    """Point-based value iteration; see :mod:`planners.point_based_solver`.

    Args:
        problem: one object, a search, or a search as stages.
        rng: samples the beliefs at which the solver works; seed 0 by default, so that a problem has one solution.
        rounds: number of simulated searches in each round; more take longer and give a higher value. By default
            :data:`ROUNDS` for one object, :data:`SEARCH_ROUNDS` for a search.
        repeat_weights: probability, in [0, 1], that the first, second, … touch of an object gives new information,
            ``(T,)``; for a repeat-aware policy (:mod:`planners.point_based_solver`) of a search. None: every touch
            does.

    Raises:
        ValueError: touch cost 0 with discount 1, too many hidden states, repeat weights out of range or for a single
            object, or no rounds.
    """
    rounds = None if rounds is None else require_rounds(rounds)
    rng = rng if rng is not None else np.random.default_rng(0)
    if isinstance(problem, TouchProblem):
        if repeat_weights is not None:
            raise InvalidArgument("repeat_weights need a SearchTouchProblem, which may have num_objects = 1")
        vectors = point_based_value_iteration(staged(problem), rng, ROUNDS if rounds is None else rounds)
        return TouchPolicy(problem, vectors[0])
    weights = None if repeat_weights is None else np.asarray(as_real(repeat_weights, "repeat_weights"), np.float64)
    if weights is not None and not (weights.ndim == 1 and ((weights >= 0.0) & (weights <= 1.0)).all()):  # NaN fails too
        raise InvalidArgument(f"repeat_weights must be a row of numbers in [0, 1], got {weights.tolist()}")
    search = problem if isinstance(problem, StagedProblem) else staged(problem)
    vectors = point_based_value_iteration(search, rng, SEARCH_ROUNDS if rounds is None else rounds)
    if weights is None:
        return SearchPolicy(problem, tuple((of_stage,) for of_stage in vectors))
    return SearchPolicy(problem, repeat_aware_vectors(search, vectors, weights, rng))


_MAX_NUMBERS = 50_000_000  # in all stored histories and their weights


def finite_horizon_value(problem: TouchProblem, max_touches: int) -> float:
    """Value of the best policy with at most ``max_touches`` touches, exact up to rounding.

    Touches are independent given the shape, so histories that differ only in order are one history.

    Args:
        problem: may have a touch cost of zero.
        max_touches: number of touches after which only CONFIRM and REJECT are left, ≥ 0.

    Raises:
        InvalidArgument: ``max_touches`` is no integer ≥ 0, or the histories take more than 50 million numbers (0.4 GB).

    >>> table = [[[0.9, 0.1], [0.1, 0.9]]]                            # right nine times in ten
    >>> problem = TouchProblem(table, prior=[0.5, 0.5], target=0, touch_cost=0.05)
    >>> round(finite_horizon_value(problem, 0), 6), round(finite_horizon_value(problem, 1), 6)
    (0.0, 0.75)
    """
    require_count("max_touches", max_touches, least=0)
    num_poses, num_shapes, num_outcomes = problem.outcome_probs.shape
    num_items = num_poses * num_outcomes
    total = 0
    for depth in range(max_touches):  # stops early: a million touches take no longer than ten
        total += comb(num_items + depth - 1, depth) * (depth + num_shapes)
        if total > _MAX_NUMBERS:
            raise InvalidArgument(
                f"the histories of {max_touches} touches in {num_poses} poses with {num_outcomes} outcomes take more "
                f"than {_MAX_NUMBERS} numbers; use solve for a bound, or at most {depth} touches"
            )
    items = problem.outcome_probs.transpose(0, 2, 1).reshape(num_items, num_shapes)
    confirm = np.where(np.arange(num_shapes) == problem.target, 1.0, -1.0)
    if max_touches == 0:
        return abs(float(problem.prior @ confirm))
    # Weights p(shape, history) of all sorted histories, level by level; values are of weights, so nothing is divided.
    levels: list[tuple[NDArray[np.int64], Floats]] = [(np.empty((1, 0), np.int64), problem.prior[None])]
    for _ in range(max_touches - 1):
        histories, weights = levels[-1]
        last = histories[:, -1] if histories.shape[1] else np.zeros(1, np.int64)
        row, item = np.nonzero(np.arange(num_items) >= last[:, None])
        levels.append((np.column_stack([histories[row], item]), weights[row] * items[item]))
    value: Floats | None = None
    for histories, weights in reversed(levels):
        best = np.abs(weights @ confirm)
        cost = problem.touch_cost * weights.sum(axis=1)
        for pose in range(num_poses):
            mine = range(pose * num_outcomes, (pose + 1) * num_outcomes)
            after = np.zeros(len(weights))
            for number in mine:
                if value is None:  # after the last touch only CONFIRM and REJECT are left
                    after += np.abs((weights * items[number]) @ confirm)
                else:
                    longer = np.sort(np.column_stack([histories, np.full(len(histories), number)]), axis=1)
                    after += value[_rank(longer, num_items)]
            best = np.maximum(best, problem.discount * after - cost)
        value = best
    assert value is not None, "there is at least the level without touches"
    return float(value[0])


def _rank(histories: NDArray[np.int64], num_items: int) -> NDArray[np.int64]:
    """Place of sorted histories ``(H, depth)`` among all of that length, in lexicographic order."""
    depth = histories.shape[1]
    rank = np.zeros(len(histories), np.int64)
    previous: NDArray[np.int64] = np.zeros(len(histories), np.int64)
    for column in range(depth):
        left = depth - column - 1
        # Number of histories that continue with a smaller item.
        begun = np.array([comb(num_items - i + left - 1, left) if i < num_items else 0 for i in range(num_items + 1)])
        before = np.concatenate([[0], begun.cumsum()])
        rank += before[histories[:, column]] - before[previous]
        previous = histories[:, column]
    return rank


def one_touch_bound(problem: SearchProblem, target: Name) -> float:
    """The largest expected return of any decider with any sensor, if each touch costs the problem's touch cost.

    One touch reveals the shape of the object: no sensor tells more, whatever its touches depend on. So the bound holds
    for live searches, not only for a discretised sensor model. It is tight where touches are informative, and exact for
    the searches of the relaxed problem.

    Args:
        problem: the search.
        target: label or index of the shape sought.

    Raises:
        UnknownName: no shape has the target's name.
        ValueError: a target out of range.

    Four objects of four shapes: 1, 2, 3 or 3 touches, because the last object needs none.

    >>> problem = SearchProblem(("sphere", "cube", "cylinder", "cone"), ("front",), num_objects=4)
    >>> round(one_touch_bound(problem, "cone"), 4)            # 1 - 0.02 · 9 / 4
    0.955
    """
    shape, number = index_of("shape", problem.shape_labels, target), problem.num_objects
    bag = problem.bag_of(shape)
    unsure = -1.0 if problem.unsure_reward is None else problem.unsure_reward

    # The probability that an object is a target, by the number of others that touches have revealed.
    revealed = np.arange(number)
    if bag is None:
        probs = np.full(number, problem.prior_probs[shape])
    else:
        left = bag[1] - revealed
        probs = np.minimum(np.divide(bag[0], left, out=np.zeros(number), where=left > 0), 1.0)

    # The largest expected return once all objects are revealed or rejected untouched: no target is among the latter.
    absent = np.append(np.cumprod(1.0 - probs[::-1])[::-1], 1.0)
    if bag is not None:  # a stranger has taken its place; a touch that shows it tells as much as one of the target
        absent += (1.0 - absent) * problem.unlisted
    values = 2.0 * absent - 1.0
    for decided in range(number - 1, -1, -1):
        prob = probs[: decided + 1]
        touch = prob - problem.touch_cost + (1.0 - prob) * values[1 : decided + 2]
        values = np.maximum.reduce([touch, 2.0 * prob - 1.0, values[: decided + 1], np.full(decided + 1, unsure)])
    return float(values[0])
