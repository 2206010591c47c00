"""Which pose to touch next."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from belief import Probe
from belief.bayes import expected_information_gain, target_information_gain
from belief.observation_model import OutcomeTable
from belief.problem import Floats
from planners.decider import Decision, InformationState, require_fit
from planners.repeats import LeastUsedFirst, RepeatDiscount


@dataclass(frozen=True)
class FixedOrder:
    """Pose 0, 1, 2, … and round again: the paper's manual sequence (§6.3)."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        return Decision(Probe(len(info.history) % info.problem.num_poses), {"target_prob": info.target_prob})


@dataclass(frozen=True)
class RandomOrder:
    """All poses once in random order, then again: what choosing poses has to beat."""

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        uses = info.uses
        return Decision(Probe(int(rng.choice(np.flatnonzero(uses == uses.min())))), {"target_prob": info.target_prob})


@dataclass(frozen=True, eq=False)
class TargetInformationGain:
    """The pose expected to tell most about whether this object is the target.

    A gain is that of a fresh touch, times the share of it which the discount leaves to a pose that was used before. Of
    equally good poses the least used is chosen, then the lowest.

    Attributes:
        table: p(outcome | pose, shape).
        repeats: what a repeat is worth; by default only poses used least compete.
    """

    table: OutcomeTable
    repeats: RepeatDiscount = field(default_factory=LeastUsedFirst)

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        require_fit(self.table, info.problem)
        return _best(info, target_information_gain(info.belief.probs, self.table.probs, info.target), self.repeats)


@dataclass(frozen=True, eq=False)
class ShapeInformationGain:
    """The pose expected to tell most about which shape this is, whether or not that helps to find the target.

    It is the usual criterion of active perception, for comparison; attributes as of :class:`TargetInformationGain`.
    """

    table: OutcomeTable
    repeats: RepeatDiscount = field(default_factory=LeastUsedFirst)

    def choose(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.ProbeSelector`."""
        require_fit(self.table, info.problem)
        return _best(info, expected_information_gain(info.belief.probs, self.table.probs), self.repeats)


def _best(info: InformationState, gains: Floats, repeats: RepeatDiscount) -> Decision:
    uses = info.uses
    weights = repeats.weights(uses)
    worth = np.where(weights > 0.0, gains * weights, -np.inf)
    best = np.flatnonzero(worth == worth.max())
    labels = info.problem.pose_labels
    scores = {f"gain_{label}": float(gain) for label, gain in zip(labels, gains * weights, strict=True)}
    return Decision(Probe(int(best[uses[best].argmin()])), {"target_prob": info.target_prob, **scores})
