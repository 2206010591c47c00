"""The planner to compare with: follows a solved policy of the search at hand on the exact belief.

The policy is solved once for every search problem and target, on the outcome table (:func:`planners.solve.solve`). Its
hidden state is the smallest exact one (:mod:`planners.touch_problem`), but for bags and for many distinct objects the
shape and whether a target was rejected before (:func:`stages_by_target`). At run time the belief is exact: it
comes from the observation model, not from discretised outcomes.

There are few poses, and repeated touches in one pose give less information than new ones. The policy therefore has a
set of alpha vectors for each number of touches that an object has had (:mod:`planners.point_based_solver`). The next
pose is chosen by one exact step of look-ahead. The value of a repeated pose is discounted by w, the fraction of a new
touch's information that a repeat adds:

    Q(p) = -λ + w_p ∑_o p(o | b, p) V_{t+1}(b_o) + (1 - w_p) V_{t+1}(b)

With ``given="body"`` and a belief about one rigid body, p(o | b, p) is that of the next touch given the touches so far,
which tells more than a first touch: how the object lies is then partly known (decision 0019).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from belief.composition import Composition
from belief.constraints import check
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Confirm, Probe, Reject, SearchProblem
from belief.validation import Floats
from planners.decider import Decision, InformationState, are_touches_used, pose_scores, require_fit
from planners.probing import HYPOTHESES, LEAST_USED, OUTCOMES, RepeatDiscount, weights_in_turn
from planners.solve import SearchPolicy, SearchTouchProblem, solve
from planners.touch_problem import StagedProblem, require_rounds, stages_by_missed

MAX_STATES = 200
"""Largest number of exact hidden states of distinct objects; four objects have 32. Independent ones have 2K, always."""
ROUNDS = (200, 200, 400, 400)
"""Number of simulated searches in each round of planning."""
_MOST_USES = 3  # of each pose on one object, after which the policy confirms or rejects
LEAST_COST = 1e-3
"""Lowest touch cost used for planning: with free touches a policy would touch until the touch limit."""


@dataclass(frozen=True, eq=False)
class PointBased:
    """Follows a policy of point-based value iteration, solved in one to four seconds when a search is first seen.

    ``rounds`` are numbers of simulated searches. ``given`` is "shape" for the outcome table of first touches, or "body"
    for the outcomes that the evidence predicts, where it is about one rigid body (decision 0019).
    """

    table: OutcomeTable
    repeats: RepeatDiscount = LEAST_USED
    rounds: Sequence[int] = ROUNDS
    given: Literal["body", "shape"] = "shape"

    def __post_init__(self) -> None:
        check(self)
        object.__setattr__(self, "rounds", require_rounds(self.rounds))

    def policy(self, problem: SearchProblem, target: int) -> SearchPolicy:
        """The policy for a search, solved once in each process."""
        require_fit(self.table, problem)
        key = (*self._identity, problem, target)
        if key not in _POLICIES:
            touch_problem = self._touch_problem(problem, target)
            _POLICIES[key] = solve(touch_problem, rounds=self.rounds, repeat_weights=self._weights)
        return _POLICIES[key]

    @cached_property
    def _identity(self) -> tuple[object, ...]:
        """The settings on which a policy depends besides the search."""
        return self.table.sha256, tuple(self._weights.tolist()), self.rounds

    @cached_property
    def _weights(self) -> Floats:
        """Weights of an object's first, second, … touch in the policy."""
        return weights_in_turn(self.repeats, self.table.num_poses, _MOST_USES)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        problem, number, touches = info.problem, info.object_index, len(info.history)
        num_poses = len(problem.pose_labels)
        policy = self.policy(problem, info.target)
        vectors, belief = policy.at(number, touches), _belief(policy, info)
        values = vectors.alphas @ belief
        best = int(values.argmax())
        value = float(values[best])
        confirm = float(values[vectors.actions == num_poses].max())
        reject = float(values[vectors.actions == num_poses + 1].max())
        scores = {"target_prob": info.target_prob, "value": value, "value_confirm": confirm, "value_reject": reject}
        stop = Decision(Confirm() if confirm > reject else Reject(), scores)
        if are_touches_used(info):
            return stop
        evidence = None if self.given == "shape" else info.evidence
        mixture = None if evidence is None else evidence.outcome_mixture(OUTCOMES, HYPOTHESES)
        if mixture is None:
            if vectors.actions[best] >= num_poses:
                return stop
            if touches == 0:
                return Decision(Probe(int(vectors.actions[best])), scores)
            probes = policy.probe_values(number, belief, touches, self.repeats.weights(info.uses))
        else:
            probes = policy.probe_values(number, belief, touches, np.ones(num_poses), mixture.table.probs)
        scores |= pose_scores("value", problem, probes)
        if probes.max() <= max(confirm, reject):
            return Decision(stop.action, scores)
        return Decision(Probe(int(probes.argmax())), scores)

    def _touch_problem(self, problem: SearchProblem, target: int) -> SearchTouchProblem | StagedProblem:
        """The problem to solve: with the exact hidden state, or the abstraction where that is too large."""
        cost, probs = max(problem.touch_cost, LEAST_COST), self.table.probs
        if isinstance(problem.composition, Composition) and not problem.unlisted:
            search = SearchTouchProblem(probs, problem.num_objects, problem.composition, target, cost)
            if problem.counts is None or search.num_states <= MAX_STATES:
                return search
        return stages_by_target(problem, probs, target, cost)


_POLICIES: dict[tuple[object, ...], SearchPolicy] = {}


def _belief(policy: SearchPolicy, info: InformationState) -> Floats:
    """Belief about the hidden state at the current object."""
    number, num_shapes = info.object_index, len(info.problem.shape_labels)
    if info.scene is not None:
        if isinstance(policy.problem, SearchTouchProblem):
            return policy.belief(number, info.scene.log_likelihoods())
        from planners.continuation_value import belief_with_missed

        return belief_with_missed(info).ravel()
    # Without a joint belief, the other objects count as rejected untouched; this object's belief is the given one.
    shapes = policy.search.stages[number].shapes
    before = policy.belief(number, np.zeros((number + 1, num_shapes)))
    marginal = np.bincount(shapes, before, minlength=num_shapes)
    ratio = np.divide(info.probs, marginal, out=np.zeros_like(marginal), where=marginal > 0.0)
    belief = before * ratio[shapes]
    return np.asarray(belief / belief.sum()) if belief.sum() > 0.0 else before


def stages_by_target(problem: SearchProblem, outcome_probs: Floats, target: int, touch_cost: float) -> StagedProblem:
    """A search with known counts of shapes as stages of 2K hidden states.

    States 0 to K - 1 are the current shape with no target rejected yet, states K to 2K - 1 with one rejected.
    Rejections do not change the probabilities of the other shapes here; in the belief they do (decision 0019).
    """
    from planners.continuation_value import shapes_ahead

    ahead = shapes_ahead(problem, target)
    later = ahead[1:]
    stages = stages_by_missed(problem.num_shapes, target, later / later.sum(axis=2, keepdims=True))
    prior = ahead[0, 0] if problem.unlisted else problem.prior_probs  # strangers count as other shapes
    initial = np.concatenate([prior, np.zeros(problem.num_shapes)])
    return StagedProblem(tuple(stages), initial, outcome_probs, touch_cost, 1.0)
