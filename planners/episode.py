"""Record of a search: its steps and its outcome."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

from belief.bayes import Belief
from belief.errors import InvalidArgument
from belief.naming import NONE_OF_THESE, UNKNOWN, UNLISTED, one_line
from belief.problem import Action, Confirm, Probe, Reject, SearchProblem, Touch, Unsure
from belief.search_progress import Outcome, success_of
from planners.decider import Decision

ACTION_NAMES: Mapping[type[Action], str] = {Confirm: "confirm", Reject: "reject", Unsure: "unsure"}
"""Names of the actions that are not probes, in records and figures."""
ACTIONS: Mapping[str, Action] = {"confirm": Confirm(), "reject": Reject(), "unsure": Unsure()}

MOVED = "moved"
"""Score of a decision: the probability that the object moved just before its last touch."""
_LIKELY = 0.5  # probability of a move that is told


@dataclass(frozen=True, eq=False)
class Step:
    """One decision.

    Attributes:
        object_index: the current object.
        belief: about that object, before the decision.
        decision: the action and its scores.
        touch: result of a probe; None for CONFIRM, REJECT, UNSURE, a probe that missed, and one beyond the touch limit.
            The score ``is_miss`` marks a miss, ``is_unasked`` a touch in a pose that nobody asked for.
    """

    object_index: int
    belief: Belief
    decision: Decision
    touch: Touch | None


@dataclass(frozen=True, eq=False)
class Episode:
    """One search.

    Attributes:
        seed: seed of the episode.
        target: index of the shape sought.
        arrangement: true shape of every object, in order of visit; :data:`belief.naming.UNKNOWN` (-1) where
            nobody knows it, and :data:`~belief.naming.UNLISTED` (-2) for a shape that is not listed.
        steps: all decisions, oldest first.
        outcome: how the search ended.
    """

    seed: tuple[int, ...]
    target: int
    arrangement: tuple[int, ...]
    steps: tuple[Step, ...]
    outcome: Outcome

    def __repr__(self) -> str:
        facts = f"target {self.target}", f"arrangement {self.arrangement}", f"{self.num_touches} touches"
        return one_line(Episode, f"seed {self.seed}", self.outcome.value, *facts)

    def __str__(self) -> str:
        """The search in words: a line for its result, and one for each object that was visited."""
        labels = self.steps[0].belief.labels
        judged = "right" if self.success else "wrong" if self.success is not None else "truth unknown"
        result = judged if self.is_answered else "no answer"
        lines = [f"search for the {labels[self.target]}: {self.outcome.value}, {result}, {self.num_touches} touches"]
        for number, shape in enumerate(self.arrangement):
            steps = [step for step in self.steps if step.object_index == number]
            if not steps:
                break
            poses = [step.decision.action.pose for step in steps if isinstance(step.decision.action, Probe)]
            probs = " → ".join(f"{step.belief.probs[self.target]:.3f}" for step in steps)
            end = ACTION_NAMES.get(type(steps[-1].decision.action), "probe beyond the touch limit")
            names = {UNKNOWN: "of unknown shape", UNLISTED: NONE_OF_THESE}
            name = names.get(shape) or f"a {labels[shape]}"
            moved = "".join(
                f", has moved before touch {touch} ({prob:.2f})"
                for touch, prob in ((touch, moved_before(step)) for touch, step in enumerate(steps))
                if prob >= _LIKELY
            )
            lines.append(
                f"  object {number + 1}, {name}: poses {poses}, p({labels[self.target]}) {probs}{moved}: {end}"
            )
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The search as paragraphs, for a notebook."""
        first, *lines = str(self).splitlines()
        return f"<p><b>{escape(first)}</b></p>" + "".join(f"<p>{escape(line.strip())}</p>" for line in lines)

    @property
    def num_touches(self) -> int:
        """Touches of the whole search."""
        return sum(step.touch is not None for step in self.steps)

    @property
    def confirmed_shape(self) -> int | None:
        """True shape of the confirmed object; None if none was confirmed, or nobody knows it."""
        if self.outcome is not Outcome.CONFIRMED:
            return None
        shape = self.arrangement[self.steps[-1].object_index]
        return None if shape == UNKNOWN else shape

    @property
    def is_answered(self) -> bool:
        """Whether the search named an object or said that there is no target; not if it was unsure or truncated."""
        return self.outcome in (Outcome.CONFIRMED, Outcome.EXHAUSTED)

    @property
    def success(self) -> bool | None:
        """Whether a target was confirmed, or all objects were rejected and none was a target; None if nobody knows."""
        index = self.steps[-1].object_index if self.steps else 0
        return success_of(self.outcome, self.target, self.arrangement, index)

    def reward(self, problem: SearchProblem) -> float:
        """Return of the search by :meth:`belief.problem.SearchProblem.reward`; truncation counts as failure.

        Raises:
            InvalidArgument: nobody knows whether the answer was right.
        """
        if self.success is None and self.is_answered:
            raise InvalidArgument("the return of a search needs the true shapes, which this one does not have")
        shape = self.confirmed_shape
        present = self.target in self.arrangement or self.outcome is Outcome.TRUNCATED
        return problem.reward(shape, self.target, self.num_touches, present, self.outcome is Outcome.UNSURE)

    def to_dict(self) -> dict[str, Any]:
        """Fields as JSON types, with exact floats; of a touch its logits, or its features where it has no logits."""
        return {
            "seed": list(self.seed),
            "target": self.target,
            "arrangement": [None if shape == UNKNOWN else shape for shape in self.arrangement],
            "outcome": self.outcome.value,
            "steps": [_step_to_dict(step) for step in self.steps],
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any], shape_labels: tuple[str, ...]) -> Episode:
        """The episode of fields from :meth:`to_dict`."""
        return cls(
            tuple(fields["seed"]),
            fields["target"],
            tuple(UNKNOWN if shape is None else shape for shape in fields["arrangement"]),
            tuple(_step_from_dict(step, shape_labels) for step in fields["steps"]),
            Outcome(fields["outcome"]),
        )


def moved_before(step: Step) -> float:
    """Probability, as of a decision, that the object moved just before the touch before it; 0.0 if it is not known."""
    return float(step.decision.scores.get(MOVED, 0.0))


def judged(episodes: Iterable[Episode]) -> list[Episode]:
    """The episodes of which it is known whether they succeeded; reports count these."""
    return [episode for episode in episodes if episode.success is not None]


def _step_to_dict(step: Step) -> dict[str, Any]:
    action, touch = step.decision.action, step.touch
    logits, features = (None, None) if touch is None else (touch.logits, touch.features)
    return {
        "object": step.object_index,
        "belief": step.belief.probs.tolist(),
        **({"unlisted": step.belief.unlisted} if step.belief.unlisted else {}),
        "action": action.pose if isinstance(action, Probe) else ACTION_NAMES[type(action)],
        "scores": dict(step.decision.scores),
        "logits": None if logits is None else logits.tolist(),
        **({"place": list(touch.elsewhere.place)} if touch is not None and touch.elsewhere is not None else {}),
        **({"features": features.tolist()} if logits is None and features is not None else {}),
    }


def _step_from_dict(fields: Mapping[str, Any], shape_labels: tuple[str, ...]) -> Step:
    name = fields["action"]
    action: Action
    touch = None
    if isinstance(name, str):
        action = ACTIONS[name]
    else:
        action = Probe(name)
        if fields["logits"] is not None or "features" in fields:
            touch = Touch(name, fields["logits"], fields.get("features"))
    belief = Belief.from_probs(shape_labels, fields["belief"], fields.get("unlisted", 0.0))
    return Step(fields["object"], belief, Decision(action, fields["scores"]), touch)
