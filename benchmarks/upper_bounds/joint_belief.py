r"""Upper bound on the value of a search in which the shapes of rejected objects are not revealed.

The bound interpolates on grids over the exact hidden state.

After some objects the hidden state is a hypothesis about those rejected, and the shape of the current one. Hypotheses
are sets of rejected shapes where shapes are distinct, and whether a target was rejected where objects are independent.
Within a stage, touches do not change the weights w of the hypotheses before the first touch. They multiply the
distribution over shapes under each hypothesis by the same likelihoods. For given w there is thus a belief about one
shape, with a grid as for one object. Between stages the value is convex in w, so interpolation between some w gives an
upper bound.

The grid of weights is ((1 - m) u, m v). Here m is the probability that the target was rejected, and u and v are the
distributions over hypotheses if it was not, and if it was. The value is convex in each of the three while the others
are fixed, so interpolating in one after the other gives an upper bound.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import combinations, product

import numpy as np

from belief import Composition
from belief.validation import Floats
from planners.pomdp.problem import SearchTouchProblem, staged
from planners.pomdp.solver import point_based_value_iteration, sample_beliefs

from .belief_grid import BeliefGrid
from .object import look_ahead
from .simplex import SimplexGrid
from .touch_costs import TouchCosts

_ROUNDS = (200, 200, 400)  # simulations per round of planning, to sample the beliefs that matter
_NUM_SEARCHES = 600
_EXPLORATION = 0.2
_GONE_PROBS = np.array([0.0, 0.02, 0.05, 0.1, 0.16, 0.24, 0.35, 0.55, 1.0])
_STEPS_ALONE, _STEPS_TOGETHER = 8, 2  # of the grid of u or v where the other is a point, or is none
_MOST_ALTERNATIVES = 3  # that u or v is about
_MOST_SHAPES = 6


class JointBeliefBound:
    """The upper bound for a search with discount 1 for which :func:`is_small` holds, computed stage by stage.

    ``rng`` samples the beliefs around which grids are fine; any grid gives a valid bound.
    """

    def __init__(self, problem: SearchTouchProblem, costs: TouchCosts, rng: np.random.Generator) -> None:
        self._problem, self._costs, self._rng = problem, costs, rng
        self._stages = [_Hypotheses(problem, number) for number in range(problem.num_objects)]
        self._tables: dict[int, Floats] = {}

    def __call__(self) -> float:
        """Upper bound on the optimal value at the start."""
        for number in range(len(self._stages) - 1, 0, -1):  # from the last one on, so that no recursion is deep
            if not self._stages[number].is_decided:
                self._tables[number] = self._table(number)
        weights = np.eye(1, self._stages[0].number)
        return float(self._bounds(0, weights, exact_steps=2)[0])

    @cached_property
    def _grid(self) -> BeliefGrid:
        """Beliefs about the shape of any one object."""
        search = staged(self._problem)
        vectors = point_based_value_iteration(search, self._rng, _ROUNDS)
        sampled = sample_beliefs(search, vectors, self._rng, _NUM_SEARCHES, _EXPLORATION)
        around = [
            np.concatenate(levels) @ np.eye(self._problem.num_shapes)[stage.shapes]
            for stage, levels in zip(search.stages, sampled, strict=True)
        ]
        return BeliefGrid(self._problem.outcome_probs, np.concatenate(around))

    def _bounds(self, number: int, weights: Floats, exact_steps: int = 1) -> Floats:
        """Bound at the start of a stage, for each row of ``weights (B, H)`` of the hypotheses; ``(B,)``."""
        grid, table = self._grid, self._problem.outcome_probs
        joint = weights[:, :, None] * self._stages[number].shape_probs  # (B, H, K)
        start = joint.sum(axis=1)
        given = np.divide(joint, start[:, None], out=np.zeros_like(joint), where=start[:, None] > 0.0)
        stops = [self._stop(number, some) for some in given]
        at_points = np.stack([stop(grid.points) for stop in stops], axis=1)  # (G, B)
        values = grid.bound(at_points, np.ones_like(at_points), self._costs.after(exact_steps))
        return np.array(
            [
                look_ahead(grid, values[:, i], start[i], stops[i], table, self._costs, exact_steps)
                for i in range(len(weights))
            ]
        )

    def _stop(self, number: int, given: Floats) -> Callable[[Floats], Floats]:
        """Upper bound on the value of stopping as a function of the belief, given p(hypothesis | shape) ``(H, K)``."""

        def stop(beliefs: Floats) -> Floats:
            confirm = 2.0 * beliefs[:, self._problem.target] - 1.0
            return np.maximum(confirm, self._reject(number, beliefs[:, None] * given))

        return stop

    def _reject(self, number: int, joint: Floats) -> Floats:
        """Upper bound on the value of REJECT at beliefs ``(B, H, K)``; ``(B,)``."""
        problem, here = self._problem, self._stages[number]
        if number + 1 == problem.num_objects:
            others = np.arange(problem.num_shapes) != problem.target
            return np.asarray(2.0 * joint[:, : here.num_kept][:, :, others].sum(axis=(1, 2)) - 1.0)
        after = np.zeros((len(joint), self._stages[number + 1].number))
        for hypothesis, rejected in enumerate(here.every):
            for shape in np.flatnonzero(here.shape_probs[hypothesis]).tolist():
                after[:, self._stages[number + 1].index(rejected, shape)] += joint[:, hypothesis, shape]
        return self._between(number + 1, after)

    def _between(self, number: int, weights: Floats) -> Floats:
        """Bound at the start of a stage, interpolated between some weights of the hypotheses; ``(B,)``."""
        stage = self._stages[number]
        kept, gone = weights[:, : stage.num_kept], weights[:, stage.num_kept :]
        if stage.is_decided:
            return np.asarray(kept.sum(axis=1) - gone.sum(axis=1))
        lost = gone.sum(axis=1)
        row = np.clip(np.searchsorted(_GONE_PROBS, lost, side="right") - 1, 0, len(_GONE_PROBS) - 2)
        share = np.clip((lost - _GONE_PROBS[row]) / (_GONE_PROBS[row + 1] - _GONE_PROBS[row]), 0.0, 1.0)
        u, u_weights = stage.kept_grid.look_up(_conditional(kept))
        v, v_weights = stage.gone_grid.look_up(_conditional(gone))
        found = np.zeros(len(weights))
        for up, part in ((0, 1.0 - share), (1, share)):
            corners = self._tables[number][(row + up)[:, None, None], u[:, :, None], v[:, None, :]]
            found += part * np.einsum("buv,bu,bv->b", corners, u_weights, v_weights)
        return found

    def _table(self, number: int) -> Floats:
        """Bounds at the start of a stage, by m and the points of the grids of u and v."""
        stage = self._stages[number]
        nodes = list(product(_GONE_PROBS, stage.kept_grid.points, stage.gone_grid.points))
        weights = np.array([np.concatenate([(1.0 - m) * u, m * v]) for m, u, v in nodes])
        different, index = np.unique(weights.round(12), axis=0, return_inverse=True)
        shape = (len(_GONE_PROBS), len(stage.kept_grid.points), len(stage.gone_grid.points))
        return self._bounds(number, different)[index].reshape(shape)


class _Hypotheses:
    """Hypotheses about the objects rejected before one: sets without the target, then sets with it.

    For independent objects the only hypotheses are that a target was rejected and that none was.
    """

    def __init__(self, problem: SearchTouchProblem, number: int) -> None:
        target, num_shapes = problem.target, problem.num_shapes
        others = [shape for shape in range(num_shapes) if shape != target]
        self._distinct = problem.composition is Composition.DISTINCT
        self._target = target
        kept: list[tuple[int, ...]] = [()]
        gone: list[tuple[int, ...]] = [(target,)]
        if self._distinct:
            kept = list(combinations(others, number))
            gone = [tuple(sorted((target, *rest))) for rest in combinations(others, number - 1)] if number else []
        self.every, self.num_kept, self.number = [*kept, *gone], len(kept), len(kept) + len(gone)
        self._index = {rejected: row for row, rejected in enumerate(self.every)}
        self.is_decided = self._distinct and number + 1 == num_shapes  # one shape is left, and CONFIRM is best
        self.shape_probs = self._shape_probs(problem)  # p(current shape | hypothesis), (H, K)
        self._num_gone = max(len(gone), 1)

    @property
    def is_small(self) -> bool:
        return self.is_decided or max(self.num_kept, self._num_gone) <= _MOST_ALTERNATIVES

    @cached_property
    def kept_grid(self) -> SimplexGrid:
        return _grid(self.num_kept, self._num_gone)

    @cached_property
    def gone_grid(self) -> SimplexGrid:
        return _grid(self._num_gone, self.num_kept)

    def index(self, rejected: tuple[int, ...], shape: int) -> int:
        """Number of the hypothesis, here, that a shape was rejected after others."""
        if self._distinct:
            return self._index[tuple(sorted((*rejected, shape)))]
        return int(self._target in (*rejected, shape))

    def _shape_probs(self, problem: SearchTouchProblem) -> Floats:
        if not self._distinct:
            assert problem.prior is not None, "filled in at construction"
            return np.tile(problem.prior, (self.number, 1))
        rows = np.ones((self.number, problem.num_shapes))
        for row, rejected in zip(rows, self.every, strict=True):
            row[list(rejected)] = 0.0
        return np.asarray(rows / rows.sum(axis=1, keepdims=True))


def is_small(problem: SearchTouchProblem) -> bool:
    """Whether the hypotheses are few enough for useful grids over all of them.

    >>> is_small(SearchTouchProblem(np.full((1, 4, 1), 1.0), 4, "distinct", target=0, touch_cost=0.1))
    True
    >>> is_small(SearchTouchProblem(np.full((1, 5, 1), 1.0), 5, "distinct", target=0, touch_cost=0.1))
    False
    """
    stages = [_Hypotheses(problem, number) for number in range(problem.num_objects)]
    return problem.num_shapes <= _MOST_SHAPES and all(stage.is_small for stage in stages)


def _grid(num_parts: int, num_others: int) -> SimplexGrid:
    steps = 1 if num_parts == 1 else _STEPS_ALONE if num_others == 1 else _STEPS_TOGETHER
    return SimplexGrid(num_parts, [steps], np.empty((0, num_parts)))


def _conditional(weights: Floats) -> Floats:
    """Rows ``(B, H)`` normalised to distributions, ``(B, max(H, 1))``; a row of zeros becomes uniform."""
    if not weights.shape[1]:
        return np.ones((len(weights), 1))
    total = weights.sum(axis=1, keepdims=True)
    uniform = np.full_like(weights, 1.0 / weights.shape[1])
    return np.divide(weights, total, out=uniform, where=total > 0.0)
