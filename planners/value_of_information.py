r"""Value of information: stop when no plan of one or two more touches has a value above its cost.

The value of stopping at a belief b is S(b) = max(c · b, r · b). Here c is +1 for the target and -1 for any other shape,
and r is the value of the search after rejecting each shape (:mod:`planners.continuation_value`). The value of one more
touch in a pose is E S(b') - λ; that of two is E max(S(b'), max_pose E S(b'') - λ) - λ. A depth of one fails where two
poses are informative only together: no single touch is worth its cost, and it never touches. A depth of two succeeds
there (the value of information is not submodular: Krause & Guestrin 2009). With a poor sensor, where a decision takes
many touches, two are not enough either, and thresholds have a higher return (docs/planners.md).

A touch in a pose that was used before gives new information with probability w and none otherwise
(:mod:`planners.probing`). It is a new touch behind an erasure channel, so its value before cost is multiplied by w.

All P² M² branches are two matrix products on unnormalised beliefs, in which an impossible outcome has weight zero.

Where the evidence of the current object has an outcome mixture, the outcomes depend on the touches so far, and given a
hypothesis about the object two touches are independent. The mixture says how much the next touch in a pose tells, so
repeats need no other discount.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, TypeAlias

import numpy as np

from belief.constraints import Count, Within, check
from belief.observation_model.outcome_mixture import Outcomes
from belief.observation_model.outcome_table import OutcomeTable
from belief.problem import Confirm, Probe, Reject, SearchProblem
from belief.validation import Floats
from planners.continuation_value import ContinuationValue
from planners.decider import Decision, InformationState, are_touches_used, pose_scores, require_fit, touch_share
from planners.probing import LEAST_USED, RepeatDiscount

_TIE = 1e-12  # differences below this are rounding
_TIE_IN_SINGLE = 1e-6  # the same, for values that were computed in single precision
_CANDIDATES = 12  # first poses, the best by a single touch, after which a second touch is looked into
_OUTCOMES = 64
_HYPOTHESES = 64

_Key: TypeAlias = tuple[int, object, float, int, int]


@dataclass(frozen=True, eq=False)
class ValueOfInformation:
    """Probes the first pose of the best plan if its value exceeds that of stopping; else confirms or rejects.

    ``table`` is p(outcome | pose, shape), ``depth`` 1 or 2 touches ahead. By default only the poses used least are
    candidates. ``max_touches`` of one object are an equal share of the touch limit by default; no search is truncated,
    because an object is confirmed or rejected where the touches of the search are used.
    """

    table: OutcomeTable
    depth: Annotated[int, Within(1, 2)] = 2
    repeats: RepeatDiscount = LEAST_USED
    max_touches: Count | None = None
    _continuations: dict[_Key, ContinuationValue] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        check(self)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`; of equally good actions stopping comes first, then the lowest pose."""
        require_fit(self.table, info.problem)
        payoffs = self.payoffs(info)
        confirm, reject = (payoffs @ info.probs).tolist()
        probes = self.probe_values(info, payoffs)
        scores = {"target_prob": info.target_prob, "value_confirm": confirm, "value_reject": reject}
        scores |= pose_scores("value", info.problem, probes)
        limit = touch_share(info.problem) if self.max_touches is None else self.max_touches
        may_touch = len(info.history) < limit and not are_touches_used(info)
        if may_touch and probes.max() > max(confirm, reject) + _TIE:
            return Decision(Probe(int(np.argmax(probes > probes.max() - _TIE))), scores)
        return Decision(Confirm() if confirm > reject else Reject(), scores)

    def payoffs(self, info: InformationState) -> Floats:
        """Value of CONFIRM and of REJECT for each shape that the current object may have, ``(2, K)``."""
        confirm = np.where(np.arange(info.problem.num_shapes) == info.target, 1.0, -1.0)
        return np.stack([confirm, self._continuation(info.problem, info.target).reject_payoffs(info)])

    def probe_values(self, info: InformationState, payoffs: Floats) -> Floats:
        """Value of the best plan that begins with a probe in each pose, ``(P,)``; -inf for poses that are excluded."""
        evidence = info.evidence
        mixture = None if evidence is None else evidence.outcome_mixture(_OUTCOMES, _HYPOTHESES)
        return self._by_table(info, payoffs) if mixture is None else self._by_mixture(mixture, info, payoffs)

    def _by_mixture(self, mixture: Outcomes, info: InformationState, payoffs: Floats) -> Floats:
        """:meth:`probe_values` for outcomes that depend on the touches so far."""
        expected, chance = mixture.payoffs_after(payoffs, info.probs)
        stop = expected.max(axis=0)
        if self.depth == 2:
            factors = payoffs * info.probs
            best = np.argsort(-stop.sum(axis=1), kind="stable")[:_CANDIDATES]
            for pose in np.sort(best).tolist():
                second = mixture.two_touches(pose, factors).max(axis=0).sum(axis=2)  # (M, P')
                again = second.max(axis=1) - (info.problem.touch_cost + _TIE_IN_SINGLE) * chance[pose]
                stop[pose] = np.maximum(stop[pose], again)
        return np.asarray(stop.sum(axis=1) - info.problem.touch_cost)

    def _by_table(self, info: InformationState, payoffs: Floats) -> Floats:
        """:meth:`probe_values` for touches that are independent given the shape, with the discount of repeats."""
        belief, cost, uses = info.probs, info.problem.touch_cost, info.uses
        num_poses, num_outcomes = self.table.num_poses, self.table.num_outcomes
        now = (payoffs @ belief).max()
        joint = belief[:, None] * self._columns  # (K, P M), p(shape, outcome)
        stop = (payoffs @ joint).max(axis=0).reshape(num_poses, num_outcomes)
        weights, new = self.repeats.weights(uses), stop.sum(axis=1)
        if self.depth == 1:
            values = weights * new + (1.0 - weights) * now - cost
        else:
            later = self.repeats.weights(uses + np.eye(num_poses, dtype=np.int64))  # (P, P'), after one in pose P
            after = np.einsum("jk,km->jmk", payoffs, joint) @ self._columns  # (2, P M, P' M')
            second = after.max(axis=0).reshape(num_poses, num_outcomes, num_poses, num_outcomes).sum(axis=3)
            chance = joint.sum(axis=0).reshape(num_poses, num_outcomes, 1)
            again = later[:, None] * second + (1.0 - later)[:, None] * stop[..., None] - cost * chance
            informed = np.maximum(stop, again.max(axis=2)).sum(axis=1)
            no_wiser = np.maximum(now, (later * new + (1.0 - later) * now).max(axis=1) - cost)
            values = weights * informed + (1.0 - weights) * no_wiser - cost
        return np.where(weights > 0.0, values, -np.inf)

    @cached_property
    def _columns(self) -> Floats:
        """The table as ``(K, P M)``."""
        return np.ascontiguousarray(self.table.probs.transpose(1, 0, 2).reshape(self.table.num_shapes, -1))

    def _continuation(self, problem: SearchProblem, target: int) -> ContinuationValue:
        key = (problem.num_objects, problem.composition, problem.touch_cost, problem.touch_limit, target)
        if key not in self._continuations:
            self._continuations[key] = ContinuationValue.of(problem, target, self.table, self.repeats)
        return self._continuations[key]
