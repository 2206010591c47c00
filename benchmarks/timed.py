"""A decider whose decisions are timed."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from planners import Decider, Decision, InformationState


@dataclass
class Timed:
    """A decider, and the processor time of each of its decisions [ms], by the type of the chosen action."""

    decider: Decider
    milliseconds: dict[type, list[float]] = field(default_factory=lambda: defaultdict(list))

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """The decision of the decider."""
        started = time.process_time()  # other processes do not count
        decision = self.decider.decide(info, rng)
        self.milliseconds[type(decision.action)].append(1e3 * (time.process_time() - started))
        return decision
