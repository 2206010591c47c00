"""What happened in a search: a list of steps and how it ended. Scores are computed from it, never stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from belief import Belief, Confirm, Probe, Reject, SearchProblem, Touch
from belief.naming import one_line
from belief.problem import Action
from planners.decider import Decision

_ACTION_NAMES = {Confirm: "confirm", Reject: "reject"}


class Outcome(StrEnum):
    """How a search ended."""

    CONFIRMED = "confirmed"
    EXHAUSTED = "exhausted"
    """Every object was rejected."""
    TRUNCATED = "truncated"
    """The touch limit was reached; a higher limit or a lower confirm threshold would let it finish."""


@dataclass(frozen=True, eq=False)
class Step:
    """One decision.

    Attributes:
        object_index: the object it was about.
        belief: about that object, when deciding.
        decision: the action and its scores.
        touch: what a probe felt; None for CONFIRM and REJECT, and for the probe the touch limit did not allow.
    """

    object_index: int
    belief: Belief
    decision: Decision
    touch: Touch | None


@dataclass(frozen=True, eq=False)
class Episode:
    """One search.

    Attributes:
        seed: what it was seeded with.
        target: index of the shape sought.
        arrangement: true shape of every object, in order of visit.
        steps: all decisions, oldest first.
        outcome: how it ended.
    """

    seed: tuple[int, ...]
    target: int
    arrangement: tuple[int, ...]
    steps: tuple[Step, ...]
    outcome: Outcome

    def __repr__(self) -> str:
        told = f"target {self.target}", f"arrangement {self.arrangement}", f"{self.num_touches} touches"
        return one_line(Episode, f"seed {self.seed}", self.outcome.value, *told)

    @property
    def num_touches(self) -> int:
        """Touches of the whole search."""
        return sum(step.touch is not None for step in self.steps)

    @property
    def confirmed_shape(self) -> int | None:
        """True shape of the object that was confirmed; None if none was."""
        if self.outcome is not Outcome.CONFIRMED:
            return None
        return self.arrangement[self.steps[-1].object_index]

    @property
    def success(self) -> bool:
        """Whether an object of the target shape was confirmed, or rightly none when there was none."""
        if self.outcome is Outcome.CONFIRMED:
            return self.confirmed_shape == self.target
        return self.outcome is Outcome.EXHAUSTED and self.target not in self.arrangement

    def reward(self, problem: SearchProblem) -> float:
        """Return of the search, :meth:`belief.problem.SearchProblem.reward`; truncation counts as failure."""
        shape = self.confirmed_shape
        present = self.target in self.arrangement or self.outcome is Outcome.TRUNCATED
        return problem.reward(shape, self.target, self.num_touches, present)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and strings, for one line of JSON; floats keep their last bit."""
        return {
            "seed": list(self.seed),
            "target": self.target,
            "arrangement": list(self.arrangement),
            "outcome": self.outcome.value,
            "steps": [_step_to_dict(step) for step in self.steps],
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any], shape_labels: tuple[str, ...]) -> Episode:
        """The episode from :meth:`to_dict`."""
        return cls(
            tuple(fields["seed"]),
            fields["target"],
            tuple(fields["arrangement"]),
            tuple(_step_from_dict(step, shape_labels) for step in fields["steps"]),
            Outcome(fields["outcome"]),
        )


def _step_to_dict(step: Step) -> dict[str, Any]:
    action = step.decision.action
    return {
        "object": step.object_index,
        "belief": step.belief.probs.tolist(),
        "action": action.pose if isinstance(action, Probe) else _ACTION_NAMES[type(action)],
        "scores": dict(step.decision.scores),
        "logits": None if step.touch is None else np.asarray(step.touch.logits, np.float64).tolist(),
    }


def _step_from_dict(fields: Mapping[str, Any], shape_labels: tuple[str, ...]) -> Step:
    name = fields["action"]
    action: Action
    touch = None
    if isinstance(name, str):
        action = Confirm() if name == _ACTION_NAMES[Confirm] else Reject()
    else:
        action = Probe(name)
        if fields["logits"] is not None:
            touch = Touch(name, np.array(fields["logits"], np.float64))
    belief = Belief.from_probs(shape_labels, fields["belief"])
    return Step(fields["object"], belief, Decision(action, fields["scores"]), touch)
