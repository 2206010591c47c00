"""Stopping that keeps its promise on top of any way to choose poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from belief import Probe
from planners.answers import checked_decision
from planners.decider import Decider, Decision, InformationState, ProbeSelector, StoppingRule


@dataclass(frozen=True)
class Confident:
    """Any decider's poses under a stopping rule: whoever chooses the probes, stops keep the rule's promise.

    Attributes:
        stopping: decides when to confirm or reject; asked first.
        decider: its probe is taken where the rule does not stop; that it would rather stop is noted in the scores.
        fallback: probes where the decider would stop and the rule would not.
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
