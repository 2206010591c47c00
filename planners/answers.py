"""Validation of the decisions of deciders."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from numbers import Real
from typing import Any

from belief.errors import ActiveTouchError, InvalidArgument, UnknownName
from belief.naming import index_of
from belief.problem import Confirm, Probe, Reject, SearchProblem, Unsure
from planners.decider import Decision

_WORKS = "a decider returns Decision(Probe(pose)), Decision(Confirm()) or Decision(Reject())"


class BadDecision(ActiveTouchError, ValueError):
    """A decider returned something that is not a decision of this search."""


def checked_decision(decision: Any, decider: object, problem: SearchProblem) -> Decision:
    """The decision with Python numbers in place of numpy's.

    Raises:
        BadDecision: it is not a :class:`Decision`, its action or pose is invalid, it is unsure in a search without this
            answer, or a score is not a finite number.

    >>> problem = SearchProblem(("cube", "cone"), ("front",), num_objects=1)
    >>> checked_decision("confirm", None, problem)
    Traceback (most recent call last):
    ...
    planners.answers.BadDecision: the decider NoneType answered 'confirm'; a decider returns Decision(Probe(pose)), \
Decision(Confirm()) or Decision(Reject())
    """
    who = f"the decider {type(decider).__name__} answered"
    if not isinstance(decision, Decision):
        raise BadDecision(f"{who} {decision!r}; {_WORKS}")
    action = decision.action
    if isinstance(action, Probe):
        pose = _pose(action.pose, problem, who)
        if type(action.pose) is not int:
            decision = replace(decision, action=Probe(pose))
    elif isinstance(action, Unsure):
        if problem.unsure_reward is None:
            raise BadDecision(f"{who} Unsure(), which this search does not have: set SearchProblem(unsure_reward=0.0)")
    elif not isinstance(action, Confirm | Reject):
        raise BadDecision(f"{who} the action {action!r}; {_WORKS}")
    return _with_plain_scores(decision, who)


def _pose(pose: Any, problem: SearchProblem, who: str) -> int:
    if not isinstance(pose, bool):
        with suppress(TypeError):  # it is no integer of any type
            pose = operator.index(pose)
    try:
        return index_of("pose", problem.pose_labels, pose)
    except (InvalidArgument, UnknownName) as error:
        raise BadDecision(
            f"{who} Probe({pose!r}); a pose is an integer in [0, {problem.num_poses}), or one of "
            f"{list(problem.pose_labels)}"
        ) from error


def _with_plain_scores(decision: Decision, who: str) -> Decision:
    scores = decision.scores
    if not isinstance(scores, Mapping):
        raise BadDecision(f"{who} with the scores {scores!r}; scores are named numbers, such as {{'value': 0.5}}")
    plain = True
    for name, value in scores.items():
        if not isinstance(name, str) or not isinstance(value, Real) or not math.isfinite(value):
            raise BadDecision(f"{who} with the score {name!r}: {value!r}; scores are named, finite numbers")
        plain = plain and isinstance(value, float)
    return decision if plain else replace(decision, scores={name: float(value) for name, value in scores.items()})
