"""Stopping by fixed thresholds on the posterior probability of the target, also in place of a decider's own rule.

The two baselines are the paper's rule, which uses single classifier outputs, and confirming at random without a touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from belief.constraints import Count, check
from belief.errors import InvalidArgument
from belief.problem import Confirm, Probe, Reject
from belief.validation import log_softmax
from planners.decider import Decider, Decision, InformationState, ProbeSelector, StoppingRule, checked_decision

_LOW_PRIOR = 1.0 / 12.0  # below it thresholds of rejection fall with the prior; the lowest prior of the named scenes
_LEAST_LOGIT = -float(np.finfo(np.float64).max)  # replaces -inf, which a perfect table gives; its softmax is zero, too


@dataclass(frozen=True)
class PosteriorThresholds:
    """Confirm or reject when the posterior of the target passes a threshold.

    The last object is confirmed without a touch if some object must be a target, because rejecting it always fails.

    A low prior alone rejects nothing (decision 0019): an object is rejected by evidence, from its own touches or those
    of other objects.

    Attributes:
        confirm: posterior at or above which to confirm.
        reject: posterior at or below which to reject, if the prior of the target in the problem is at least 1/12. A
            lower prior lowers it in proportion, and it is at most half the prior (:meth:`reject_at`).
        max_touches: touches of one object after which the more probable decision is taken.
    """

    confirm: float = 0.99
    reject: float = 0.01
    max_touches: Count = 12

    def __post_init__(self) -> None:
        if not 0.0 <= self.reject < self.confirm <= 1.0:
            raise InvalidArgument(f"need 0 ≤ reject < confirm ≤ 1, got {self.reject} and {self.confirm}")
        check(self)

    def reject_at(self, prior_prob: float) -> float:
        """Posterior of the target at or below which an object is rejected, for a prior of the problem.

        >>> [round(PosteriorThresholds(reject=0.01).reject_at(prior), 6) for prior in (0.25, 1 / 12, 0.001)]
        [0.01, 0.01, 0.00012]
        """
        return min(self.reject * share_of_threshold(prior_prob), prior_prob / 2.0)

    def stop(self, info: InformationState) -> Decision | None:
        """See :class:`planners.decider.StoppingRule`."""
        reject = self.reject_at(float(info.problem.prior_probs[info.target]))
        prob = info.target_prob
        scores = {"target_prob": prob}
        must_be_here = info.num_left == 1 and info.problem.prior_absent_probs[info.target] == 0.0
        if prob >= self.confirm or (must_be_here and prob > 0.0):
            return Decision(Confirm(), scores)
        if prob <= reject:
            return Decision(Reject(), scores)
        if len(info.history) >= self.max_touches:
            return Decision(Confirm() if prob >= 0.5 else Reject(), scores)
        return None


def share_of_threshold(prior_prob: float) -> float:
    """Factor of a threshold of rejection for a low prior of the target, in [0, 1] (decision 0019)."""
    return min(prior_prob / _LOW_PRIOR, 1.0)


@dataclass(frozen=True)
class StopOverride:
    """Follows the poses of any decider, and stops by a stopping rule.

    The error rates of the rule hold for every decider, because they do not depend on which poses are probed.

    Attributes:
        stopping: decides when to stop; it is asked first.
        decider: chooses the pose where the rule does not stop.
        fallback: chooses the pose where the decider would stop and the rule does not; the scores then say
            ``overruled``.
    """

    stopping: StoppingRule
    decider: Decider
    fallback: ProbeSelector

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        stopped = self.stopping.stop(info)
        if stopped is not None:
            return stopped
        wanted = checked_decision(self.decider.decide(info, rng), self.decider, info.problem)
        if isinstance(wanted.action, Probe):
            return wanted
        chosen = self.fallback.choose(info, rng)
        return Decision(chosen.action, {**chosen.scores, "overruled": 1.0})


@dataclass(frozen=True)
class ThresholdRule:
    """The paper's manual threshold rule (§6.3), which reads single classifier outputs and does not fuse them.

    The rule confirms when the target's probability exceeds ``high`` in ``num_consecutive`` frames in a row, and rejects
    when it is below ``low`` in the latest frame. The paper gives no values for the thresholds, and it does not say what
    happens at the maximum number of contacts; there, this rule rejects the object (decision 0031).

    Attributes:
        high, low: thresholds on the classifier's softmax, without calibration; 0 ≤ low ≤ high ≤ 1.
        num_consecutive: number of frames in a row that must exceed ``high``; at least 1.
        max_touches: maximum number of contacts with one object; at least 1.
    """

    high: float = 0.9
    low: float = 0.1
    num_consecutive: Count = 2
    max_touches: Count = 12

    def __post_init__(self) -> None:
        if not 0.0 <= self.low <= self.high <= 1.0:
            raise InvalidArgument(f"need 0 ≤ low ≤ high ≤ 1, got {self.low} and {self.high}")
        check(self)

    def stop(self, info: InformationState) -> Decision | None:
        """See :class:`planners.decider.StoppingRule`."""
        if not info.history:
            return None
        recent = info.history[-self.num_consecutive :]
        logits = [np.maximum(touch.require_logits(), _LEAST_LOGIT) for touch in recent]
        with np.errstate(under="ignore"):
            frames = [float(np.exp(log_softmax(row)[info.target])) for row in logits]
        scores = {"frame_prob": frames[-1], "target_prob": info.target_prob}
        if len(frames) == self.num_consecutive and min(frames) > self.high:
            return Decision(Confirm(), scores)
        if frames[-1] < self.low or len(info.history) >= self.max_touches:
            return Decision(Reject(), scores)
        return None


@dataclass(frozen=True)
class RandomConfirm:
    """Confirms one object at random, without touching: the no-touch baseline.

    Each of the N objects is confirmed with probability 1/N; with K shapes equally likely it succeeds once in K.
    """

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        confirm = rng.random() < 1.0 / info.num_left
        return Decision(Confirm() if confirm else Reject(), {"target_prob": info.target_prob})
