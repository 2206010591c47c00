"""Baselines: the paper's threshold rule, and confirming at random without a touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from belief.calibration import TemperatureScaling
from belief.errors import InvalidArgument
from belief.problem import Confirm, Reject
from belief.validation import require_count
from planners.decider import Decision, InformationState

_SOFTMAX = TemperatureScaling()  # with its default temperature of 1; handles logits of any size
_LEAST_LOGIT = -float(np.finfo(np.float64).max)  # replaces -inf, which a perfect table gives; its softmax is zero, too


@dataclass(frozen=True)
class ThresholdRule:
    """The paper's manual threshold rule (§6.3), which reads single classifier outputs and does not fuse them.

    The rule confirms when the target's probability exceeds ``high`` in ``num_consecutive`` frames in a row, and rejects
    when it is below ``low`` in the latest frame. The paper gives no values for the thresholds, and it does not say what
    happens at the maximum number of contacts; there, this rule rejects the object (decision 0005).

    Attributes:
        high, low: thresholds on the classifier's softmax, without calibration; 0 ≤ low ≤ high ≤ 1.
        num_consecutive: number of frames in a row that must exceed ``high``; at least 1.
        max_touches: maximum number of contacts with one object; at least 1.

    Raises:
        InvalidArgument: A threshold or a count is out of its range.
    """

    high: float = 0.9
    low: float = 0.1
    num_consecutive: int = 2
    max_touches: int = 12

    def __post_init__(self) -> None:
        if not 0.0 <= self.low <= self.high <= 1.0:
            raise InvalidArgument(f"need 0 ≤ low ≤ high ≤ 1, got {self.low} and {self.high}")
        require_count("num_consecutive", self.num_consecutive)
        require_count("max_touches", self.max_touches)

    def stop(self, info: InformationState) -> Decision | None:
        """See :class:`planners.decider.StoppingRule`."""
        if not info.history:
            return None
        recent = info.history[-self.num_consecutive :]
        logits = [np.maximum(touch.require_logits(), _LEAST_LOGIT) for touch in recent]
        frames = [float(_SOFTMAX.predict_proba(row)[info.target]) for row in logits]
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
