"""A decider that answers "I do not know" where its answer would not be reliable.

There are five reasons. The scores of the decision name the one that applied:

- ``is_conflict``: the conflict test of the observation model says that the touches do not come from the world that the
  sensor knows, so the posterior means nothing. The test is read before every decision, not only before an answer. Its
  false-alarm rate is for all readings together; the first alarm is the strongest evidence; and
  further touches cost, but cannot make the sensor fit the world.
- ``is_doubtful``: the decider would answer although the probability that its answer is right is below the promise. This
  happens at a maximum number of touches.
- ``is_suspicious``: the decider would answer while the conflict test, without an alarm yet, makes it doubtful that the
  sensor knows this world. An answer is right with its stated probability in the sensor's own world only
  (decision 0004).
- ``is_unlisted``: the decider would answer, below the promise, because the object has probably none of the listed
  shapes. More touches make it more certain that it has none, and never a better answer.
- ``is_cut_off``: the decider would touch once more, and the touch limit of the search forbids it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isnan, log
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np

from belief.constraints import Checked, Fraction, Probability, Within
from belief.errors import BrokenContract
from belief.problem import Confirm, Probe, Reject, Unsure
from planners.decider import Decider, Decision, InformationState, are_touches_used, checked_decision, require_unsure

CONFLICT, ANSWER = "log_conflict", "answer_prob"
"""Scores of decisions: the statistic of the conflict test, and the stated probability that an answer is right."""
REASONS = MappingProxyType(
    {
        "is_conflict": "the touches contradict the observation model",
        "is_doubtful": "no answer is probable enough, and more touches are not worth their cost or not allowed",
        "is_suspicious": "the touches make it doubtful that the sensor knows this world",
        "is_unlisted": "the object has probably none of the shapes",
        "is_cut_off": "the limit of touches is reached",
    }
)
"""Scores that say why a search ended with "I do not know"."""
_LARGEST = 1e150  # a statistic of infinite size is recorded as this: scores are finite


@dataclass(frozen=True)
class Abstaining(Checked):
    """Follows any decider, but answers "I do not know" on conflict, and where the promise cannot be kept.

    Rejecting an object is an answer only if it is the last one: it says that there is no target. Rejecting an earlier
    object is never overruled for its probability, because a later answer can still be reliable. To touch on where a
    decider would stop below the promise, wrap a :class:`planners.stopping.StopOverride`.

    Every decision has the score ``log_conflict``, and every answer ``answer_prob``, the stated probability that it is
    right.

    Attributes:
        decider: the decider that is followed.
        false_alarm: nominal probability that the conflict test ends a search in the sensor's own world; in (0, 1). The
            test raises an alarm when ``info.scene.log_conflict`` reaches log(1 / false_alarm). Where some objects of
            that world are odd in all their touches, alarms may be more frequent; see :mod:`belief.conflict`.
        promise: smallest stated probability of being right at which an answer is given; in [0, 1].
        suspicion: e-value of the conflict test from which no answer is given, above 1; infinite for never. At
            3.5, a prior of 0.015 for a changed world becomes a posterior of 0.05.

    Raises:
        InvalidArgument: a number is outside its range; in :meth:`decide`, the search does not have the answer
            "I do not know".
        BrokenContract: in :meth:`decide`, the statistic of the conflict test is NaN.

    >>> from belief import Belief, SearchProblem
    >>> from planners.stopping import RandomConfirm
    >>> problem = SearchProblem(("cube", "cone"), ("front",), num_objects=1, unsure_reward=0.0)
    >>> info = InformationState(problem, 0, Belief.uniform(("cube", "cone")))
    >>> Abstaining(RandomConfirm()).decide(info, np.random.default_rng(0)).action
    Unsure()
    """

    decider: Decider
    false_alarm: Fraction = 0.02
    promise: Probability = 0.95
    suspicion: Annotated[float, Within(1.0, inf, open_low=True)] = 3.5

    @property
    def stop_rule(self) -> Any:
        """The stop rule of the decider that is followed, or None."""
        return getattr(self.decider, "stop_rule", None)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        require_unsure(info.problem, "an abstaining decider needs")
        conflict = _log_conflict(info)
        if conflict >= -log(self.false_alarm):
            return _unsure("is_conflict", {CONFLICT: conflict, "target_prob": info.target_prob})
        wanted = checked_decision(self.decider.decide(info, rng), self.decider, info.problem)
        scores = {**wanted.scores, CONFLICT: conflict}
        if isinstance(wanted.action, Probe):
            is_over = are_touches_used(info)
            return _unsure("is_cut_off", scores) if is_over else Decision(wanted.action, scores)
        prob = answer_prob(wanted.action, info)
        if prob is None:
            return Decision(wanted.action, scores)
        scores[ANSWER] = prob
        if prob < self.promise:
            return _unsure("is_unlisted" if info.belief.unlisted > 0.5 else "is_doubtful", scores)
        return _unsure("is_suspicious", scores) if conflict >= log(self.suspicion) else Decision(wanted.action, scores)


def answer_prob(action: Confirm | Reject | Unsure, info: InformationState) -> float | None:
    """Stated probability that an answer is right: the object is the target, or no object is one.

    Args:
        action: the action that ends the touches of the current object.
        info: the state in which it was chosen.

    Returns:
        None for an action that is no answer: "I do not know", or the rejection of an object that is not the last.
    """
    if isinstance(action, Confirm):
        return min(info.target_prob, 1.0)
    if isinstance(action, Unsure) or info.num_left > 1:
        return None
    if info.scene is None:
        return max(1.0 - info.target_prob, 0.0)  # of this object alone: nothing is known about the rejected ones
    return min(max(1.0 - info.scene.prob_present(info.target), 0.0), 1.0)


def _log_conflict(info: InformationState) -> float:
    """The statistic of the conflict test, finite; 0 without a joint belief."""
    conflict = 0.0 if info.scene is None else float(info.scene.log_conflict)
    if isnan(conflict):
        raise BrokenContract("log_conflict of a scene is NaN; an observation model must give a number")
    return min(max(conflict, -_LARGEST), _LARGEST)


def _unsure(reason: str, scores: dict[str, float]) -> Decision:
    return Decision(Unsure(), {**scores, reason: 1.0})
