"""Probe selectors: rules that choose the next pose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from belief import Probe
from belief.bayes import expected_information_gain, target_information_gain
from belief.observation_model import OutcomeTable
from belief.problem import Floats
from planners.decider import Decision, InformationState, require_fit
from planners.next_touch import next_touch
from planners.repeats import LeastUsedFirst, RepeatDiscount


@dataclass(frozen=True)
class FixedOrder:
    """Poses 0, 1, 2, … in turn, repeated: the paper's manual sequence (§6.3)."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        return Decision(Probe(len(info.history) % info.problem.num_poses), {"target_prob": info.target_prob})


@dataclass(frozen=True)
class RandomOrder:
    """All poses once in random order, then again: a baseline for the choice of poses."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        uses = info.uses
        return Decision(Probe(int(rng.choice(np.flatnonzero(uses == uses.min())))), {"target_prob": info.target_prob})


@dataclass(frozen=True, eq=False)
class TargetInformationGain:
    """The pose with the largest expected information gain about whether this object is the target.

    Where the evidence has an outcome mixture, the gain is that after the touches so far. Otherwise the gain is that of
    the table; for a pose that was used before it is multiplied by its repeat weight. Of equally good poses the least
    used is chosen, then the lowest.

    Attributes:
        table: p(outcome | pose, shape) of single touches.
        repeats: discounts the value of repeated poses; by default only the poses used least are candidates.
    """

    table: OutcomeTable
    repeats: RepeatDiscount = field(default_factory=LeastUsedFirst)

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        require_fit(self.table, info.problem)
        table, weights = next_touch(info, self.table, self.repeats)
        return _best(info, target_information_gain(info.belief.probs, table.probs, info.target), weights)


@dataclass(frozen=True, eq=False)
class ShapeInformationGain:
    """The pose with the largest expected information gain about the shape of this object.

    It is the usual criterion of active perception, for comparison. It has the attributes of
    :class:`TargetInformationGain`.
    """

    table: OutcomeTable
    repeats: RepeatDiscount = field(default_factory=LeastUsedFirst)

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        require_fit(self.table, info.problem)
        table, weights = next_touch(info, self.table, self.repeats)
        return _best(info, expected_information_gain(info.belief.probs, table.probs), weights)


def _best(info: InformationState, gains: Floats, weights: Floats) -> Decision:
    uses = info.uses
    values = np.where(weights > 0.0, gains * weights, -np.inf)
    best = np.flatnonzero(values == values.max())
    labels = info.problem.pose_labels
    scores = {f"gain_{label}": float(gain) for label, gain in zip(labels, gains * weights, strict=True)}
    return Decision(Probe(int(best[uses[best].argmin()])), {"target_prob": info.target_prob, **scores})
