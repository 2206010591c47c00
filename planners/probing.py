"""Which pose to touch next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief import Probe
from belief.bayes import target_information_gain
from belief.observation_model import OutcomeTable
from planners.decider import Decision, InformationState


@dataclass(frozen=True)
class FixedOrder:
    """Pose 0, 1, 2, … and round again: the paper's manual sequence (§6.3)."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        return Decision(Probe(len(info.history) % info.problem.num_poses), {"target_prob": info.target_prob})


@dataclass(frozen=True, eq=False)
class TargetInformationGain:
    """The pose expected to tell most about whether this object is the target.

    Only poses used least so far compete: a second touch in the same pose nearly repeats the first, which a table of
    single touches cannot know (decision 0006). Ties go to the lowest pose.

    Attributes:
        table: p(outcome | pose, shape).
    """

    table: OutcomeTable

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        gains = target_information_gain(info.belief.probs, self.table.probs, info.target)  # (P,)
        uses = num_uses(info)
        pose = int(np.argmax(np.where(uses == uses.min(), gains, -np.inf)))
        labels = info.problem.pose_labels
        scores = {f"gain_{label}": float(gain) for label, gain in zip(labels, gains, strict=True)}
        return Decision(Probe(pose), {"target_prob": info.target_prob, **scores})


def num_uses(info: InformationState) -> NDArray[np.int64]:
    """How often the current object was touched in each pose, ``(P,)``."""
    poses = np.array([touch.pose for touch in info.history], np.int64)
    return np.bincount(poses, minlength=info.problem.num_poses)
