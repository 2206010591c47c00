r"""Stop when no plan of one or two more touches is worth its cost: Bayes-risk stopping without thresholds.

Stopping at a belief b is worth S(b) = max(c · b, r · b), where c pays +1 for confirming the target and -1 for anything
else, and r is what going on with the search is worth after rejecting each shape (:mod:`planners.continuation_value`).
One more touch in a pose is worth E S(b') - λ; two are worth E max(S(b'), max_pose E S(b'') - λ) - λ. Looking one touch
ahead fails
where poses tell something only together: then no single touch is worth its cost, and it never touches. Looking two
ahead finds these (Krause & Guestrin 2009 call the value of information non-submodular). With a sensor so poor that a
decision takes many touches, two are not enough either: thresholds then return more (docs/planners.md).

A pose that was used before tells anew only in a share w of the cases (:mod:`planners.repeats`), and nothing in the
others: it is an erasure channel in front of a new touch, so that what it is worth beyond its cost shrinks by w.

All P² M² branches are two matrix products on unnormalised beliefs; nothing is divided, and an impossible outcome weighs
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np

from belief import Confirm, Probe, Reject, SearchProblem
from belief.errors import InvalidArgument
from belief.observation_model import OutcomeTable
from belief.problem import Floats
from planners.continuation_value import ContinuationValue
from planners.decider import Decision, InformationState, require_fit
from planners.repeats import LeastUsedFirst, RepeatDiscount
from planners.stopping import require_count

_TIE = 1e-12  # differences that rounding can make

_Key: TypeAlias = tuple[int, tuple[int, ...] | None, float, int]


@dataclass(frozen=True, eq=False)
class ValueOfInformation:
    """Probes in the pose that starts the best plan, if that is worth its cost; else confirms or rejects.

    Attributes:
        table: p(outcome | pose, shape).
        depth: touches to look ahead, 1 or 2.
        repeats: what a repeat is worth; by default only poses used least compete.
        max_touches: of one object; by default an equal share of the problem's touch limit, so that searches are never
            cut off, not even where touches cost nothing.

    Raises:
        InvalidArgument: another depth, or a number of touches that is none.

    Two poses, each of which tells one of the two bits by which four shapes differ: one alone cannot find the target
    often enough to be worth anything, so looking one touch ahead gives up at once.

    >>> from belief import Belief
    >>> bits = OutcomeTable(np.array([np.eye(2)[[0, 0, 1, 1]], np.eye(2)[[0, 1, 0, 1]]]))
    >>> problem = SearchProblem(tuple("abcd"), ("first", "second"), num_objects=1, composition="independent")
    >>> info = InformationState(problem, 0, Belief.uniform("abcd"))
    >>> [ValueOfInformation(bits, depth).decide(info, np.random.default_rng(0)).action for depth in (1, 2)]
    [Reject(), Probe(pose=0)]
    """

    table: OutcomeTable
    depth: int = 2
    repeats: RepeatDiscount = field(default_factory=LeastUsedFirst)
    max_touches: int | None = None
    _rest_values: dict[_Key, ContinuationValue] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.depth not in (1, 2):
            raise InvalidArgument(f"depth must be 1 or 2, got {self.depth!r}")
        if self.max_touches is not None:
            require_count("max_touches", self.max_touches)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`; of equally good actions stopping comes first, then the lowest pose."""
        require_fit(self.table, info.problem)
        payoffs = self.payoffs(info)
        confirm, reject = (payoffs @ info.belief.probs).tolist()
        probes = self.probe_values(info, payoffs)
        labels = info.problem.pose_labels
        scores = {
            "target_prob": info.target_prob,
            "value_confirm": confirm,
            "value_reject": reject,
            **{
                f"value_{label}": value for label, value in zip(labels, probes.tolist(), strict=True) if value > -np.inf
            },
        }
        limit = self.max_touches
        if limit is None:
            limit = max(info.problem.touch_limit // info.problem.num_objects, 1)
        if len(info.history) < limit and probes.max() > max(confirm, reject) + _TIE:
            return Decision(Probe(int(np.argmax(probes > probes.max() - _TIE))), scores)
        return Decision(Confirm() if confirm > reject else Reject(), scores)

    def payoffs(self, info: InformationState) -> Floats:
        """What CONFIRM and REJECT are worth for each shape that the current object may have, ``(2, K)``."""
        confirm = np.where(np.arange(info.problem.num_shapes) == info.target, 1.0, -1.0)
        return np.stack([confirm, self._rest(info.problem, info.target).reject_payoffs(info)])

    def probe_values(self, info: InformationState, payoffs: Floats) -> Floats:
        """What the best plan is worth that begins with a probe in each pose, ``(P,)``; -inf out of the running."""
        belief, cost, uses = info.belief.probs, info.problem.touch_cost, info.uses
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

    def _rest(self, problem: SearchProblem, target: int) -> ContinuationValue:
        key = (problem.num_objects, problem.counts, problem.touch_cost, target)
        if key not in self._rest_values:
            self._rest_values[key] = ContinuationValue.of(problem, target, self.table, self.repeats)
        return self._rest_values[key]
