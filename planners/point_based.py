"""The default planner: point-based plans for the search at hand, followed on the exact belief.

Plans are made once for every search problem and target, on the outcome table: for the smallest exact hidden state where
that has at most some thousand values (:mod:`planners.pomdp.stages`), else for whether a target was rejected before
(:mod:`planners.target_abstraction`). What was felt comes in as it is, through the observation model, not as outcomes.

Poses are few and touches in one repeat each other, so there are plans for each number of touches that an object has had
(:mod:`planners.pomdp.repeat_aware`). Which pose is next is decided by one exact step of looking ahead, in which a pose
that was used before adds only the share w of a fresh touch's worth that repeats leave it:

    Q(p) = -λ + w_p ∑_o p(o | b, p) W_{t+1}(b_o) + (1 - w_p) W_{t+1}(b)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from belief import Composition, Confirm, Probe, Reject, SearchProblem
from belief.observation_model import OutcomeTable
from belief.problem import Floats
from planners.decider import Decision, InformationState, require_fit
from planners.pomdp.alpha_vectors import Plans
from planners.pomdp.repeat_aware import limited_plans
from planners.pomdp.solver import point_based
from planners.pomdp.stages import StagedProblem, num_states, stage_belief, staged
from planners.repeats import LeastUsedFirst, RepeatDiscount, weights_in_turn
from planners.solve import SearchTouchProblem
from planners.solve.policy_files import table_sha256
from planners.target_abstraction import belief_by_target, stages_by_target

MAX_STATES = 200
"""Hidden states up to which a search is planned exactly; four distinct objects have 32."""
ROUNDS = (200, 200, 400, 400)
"""Searches simulated in each round of planning."""
_MOST_USES = 3  # of each pose on one object, after which it is decided
LEAST_COST = 1e-3
"""Price of a touch at the least, when planning: free touches would be made until the touch limit."""


@dataclass(frozen=True, eq=False)
class Planned:
    """Plans for a search and a target.

    Attributes:
        search: what was planned for.
        plans: for every object, by number of touches it has had.
        exact: whether the hidden state is.
    """

    search: StagedProblem
    plans: Sequence[Sequence[Plans]]
    exact: bool


@dataclass(frozen=True, eq=False)
class PointBased:
    """Follows point-based plans; made when a search is first seen, in a fraction of a second.

    Attributes:
        table: p(outcome | pose, shape).
        repeats: what one more touch in a pose is worth that was used before.
        rounds: searches simulated in each round of planning.
    """

    table: OutcomeTable
    repeats: RepeatDiscount = field(default_factory=LeastUsedFirst)
    rounds: Sequence[int] = ROUNDS

    def planned(self, problem: SearchProblem, target: int) -> Planned:
        """The plans for a search, which follow from this decider and the search alone; made once a process.

        Raises:
            TableMismatch: the table is about other poses or shapes than the search.
        """
        require_fit(self.table, problem)
        key = (*self._identity, repr(problem), target)
        if key not in _MADE:
            search, exact = self._stages(problem, target)
            rng = np.random.default_rng(0)
            fresh = point_based(search, rng, self.rounds)
            weights = weights_in_turn(self.repeats, problem.num_poses, _MOST_USES)
            _MADE[key] = Planned(search, limited_plans(search, fresh, weights, rng), exact)
        return _MADE[key]

    @cached_property
    def _identity(self) -> tuple[object, ...]:
        """What plans follow from, besides the search."""
        return table_sha256(self.table.probs), repr(self.repeats), tuple(self.rounds)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        problem, target, number = info.problem, info.target, info.object_index
        planned = self.planned(problem, target)
        by_touches, num_poses = planned.plans[number], problem.num_poses
        touches = min(len(info.history), len(by_touches) - 1)
        plans = by_touches[touches]
        belief = self._belief(planned, info)
        worth = plans.alphas @ belief
        best = int(worth.argmax())
        value = float(worth[best])
        confirm = float(worth[plans.actions == num_poses].max())
        reject = float(worth[plans.actions == num_poses + 1].max())
        scores = {"target_prob": info.target_prob, "value": value, "value_confirm": confirm, "value_reject": reject}
        stop = Decision(Confirm() if confirm > reject else Reject(), scores)
        if plans.actions[best] >= num_poses or _all_touches_used(info):
            return stop
        if not info.history:
            return Decision(Probe(int(plans.actions[best])), scores)
        weights = self.repeats.weights(info.uses)
        probes = _look_ahead(planned.search, number, by_touches[touches + 1], belief, weights)
        scores |= {
            f"value_{label}": float(q) for label, q in zip(problem.pose_labels, probes, strict=True) if q > -np.inf
        }
        if probes.max() <= max(confirm, reject):
            return Decision(stop.action, scores)
        return Decision(Probe(int(probes.argmax())), scores)

    def _stages(self, problem: SearchProblem, target: int) -> tuple[StagedProblem, bool]:
        cost, probs = max(problem.touch_cost, LEAST_COST), self.table.probs
        if isinstance(problem.composition, Composition):
            search = SearchTouchProblem(probs, problem.num_objects, problem.composition, target, cost)
            if num_states(search) <= MAX_STATES:
                return staged(search), True
        return stages_by_target(problem, probs, target, cost), False

    def _belief(self, planned: Planned, info: InformationState) -> Floats:
        """About the hidden state of the current object."""
        number, search = info.object_index, planned.search
        if info.scene is not None:
            if planned.exact:
                return stage_belief(search, info.scene.log_likelihoods(), number)
            return belief_by_target(info.problem, info.scene, info.target, number)
        # Nothing is known of the others: as if they had been rejected untouched, with this object's belief as given.
        shapes = search.stages[number].shapes
        before = stage_belief(search, np.zeros((number + 1, info.problem.num_shapes)), number)
        marginal = np.bincount(shapes, before, minlength=info.problem.num_shapes)
        ratio = np.divide(info.belief.probs, marginal, out=np.zeros_like(marginal), where=marginal > 0.0)
        belief = before * ratio[shapes]
        return np.asarray(belief / belief.sum()) if belief.sum() > 0.0 else before


_MADE: dict[tuple[object, ...], Planned] = {}


def _look_ahead(search: StagedProblem, number: int, after: Plans, belief: Floats, weights: Floats) -> Floats:
    """What one more touch in each pose is worth, ``(P,)``."""
    joint = np.moveaxis(belief[:, None] * search.likelihoods(number), 2, 1)  # (P, M, n)
    fresh = (joint @ after.alphas.T).max(axis=2).sum(axis=1)
    worth = weights * fresh + (1.0 - weights) * float((after.alphas @ belief).max()) - search.touch_cost
    return np.where(weights > 0.0, worth, -np.inf)


def _all_touches_used(info: InformationState) -> bool:
    if info.scene is None:
        return len(info.history) >= info.problem.touch_limit
    spent = sum(len(info.scene.touches(number)) for number in range(info.object_index + 1))
    return spent >= info.problem.touch_limit
