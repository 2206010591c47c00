"""No-touch baseline: confirms an object at random without touching anything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from belief.problem import Confirm, Reject
from planners.decider import Decision, InformationState


@dataclass(frozen=True)
class RandomConfirm:
    """Confirms one object at random, without touching: the no-touch baseline.

    Each of the N objects is confirmed with probability 1/N; with K shapes equally likely it succeeds once in K.
    """

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        confirm = rng.random() < 1.0 / info.num_left
        return Decision(Confirm() if confirm else Reject(), {"target_prob": info.target_prob})
