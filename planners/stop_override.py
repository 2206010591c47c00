"""A decider with its stopping replaced by a stopping rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from belief.problem import Probe
from planners.answers import checked_decision
from planners.decider import Decider, Decision, InformationState, ProbeSelector, StoppingRule


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
