r"""Touch problems in Cassandra's ``.pomdp`` format, for other solvers: pomdp-solve, SARSOP, POMDPs.jl.

A file holds the discount, states, actions, observations, the start, and full tables T(s' | a, s), O(o | a, s') and
R(s, a). The states are those of :mod:`planners.pomdp.stages` and a terminal one with reward zero. Many solvers need a
discount below one, SARSOP among them; a problem with discount 1 may be exported with 0.999 instead. Labels that the
format does not allow, or that it uses as words, are renamed; a comment in the file says how.

>>> from planners.solve import TouchProblem
>>> table = np.array([[[0.9, 0.1], [0.1, 0.9]]])
>>> text = to_pomdp(TouchProblem(table, [0.5, 0.5], target=0, touch_cost=0.05), ("cube", "cone"), ("front",))
>>> print("\n".join(text.splitlines()[1:7]))
discount: 1.0
values: reward
states: cube cone end
actions: probe_front confirm reject
observations: outcome_0 outcome_1 nothing
start: 0.5 0.5 0.0
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from belief.errors import InvalidArgument
from belief.validation import Floats
from planners.pomdp.problem import SearchTouchProblem, TouchProblem
from planners.pomdp.stages import StagedProblem, staged

_MAX_NUMBERS = 4_000_000
_RESERVED = frozenset(
    re.findall(
        r"\w+",
        "discount values states actions observations T O R uniform identity reward cost start include exclude reset",
    )
)


@dataclass(frozen=True, eq=False)
class TabularPomdp:
    """A partially observable Markov decision process as arrays.

    Attributes:
        discount: γ.
        states, actions, observations: labels.
        start: of the state, ``(S,)``.
        transitions: T(s' | a, s), ``(A, S, S)``.
        observation_probs: O(o | a, s'), ``(A, S, O)``.
        rewards: R(s, a), ``(A, S)``.
        plain: the labels of states, actions and observations before the format's rules changed them.
    """

    discount: float
    states: tuple[str, ...]
    actions: tuple[str, ...]
    observations: tuple[str, ...]
    start: Floats
    transitions: Floats
    observation_probs: Floats
    rewards: Floats
    plain: tuple[str, ...]


def as_pomdp(
    problem: TouchProblem | SearchTouchProblem,
    shape_labels: Sequence[str] | None = None,
    pose_labels: Sequence[str] | None = None,
) -> TabularPomdp:
    """A touch problem as arrays.

    Args:
        problem: one object, or a small search.
        shape_labels: names of the shapes; ``shape_0`` and so on by default.
        pose_labels: names of the poses; ``pose_0`` and so on by default.

    Raises:
        InvalidArgument: a wrong number of names, or tables with more than four million entries.

    >>> from planners.solve import SearchTouchProblem
    >>> pomdp = as_pomdp(SearchTouchProblem(np.full((1, 2, 2), 0.5), 2, "distinct", target=0, touch_cost=0.1))
    >>> pomdp.states
    ('object_0_shape_0', 'object_0_shape_1', 'object_1_shape_1', 'object_1_shape_0', 'end')
    """
    stages = staged(problem)
    num_poses, _, num_outcomes = problem.outcome_probs.shape
    labels = _plain_labels(problem, stages, shape_labels, pose_labels)
    states, actions, observations = map(legal_labels, labels)
    sizes = [len(stage.shapes) for stage in stages.stages]
    num_states, num_actions = sum(sizes) + 1, num_poses + 2
    if num_actions * num_states * (num_states + num_outcomes + 1) > _MAX_NUMBERS:
        raise InvalidArgument(
            f"{num_states} states, {num_actions} actions and {num_outcomes} outcomes make a file of more than "
            f"{_MAX_NUMBERS} numbers; export fewer objects, or use planners.solve"
        )
    end, starts = num_states - 1, np.concatenate([[0], np.cumsum(sizes)])
    transitions = np.zeros((num_actions, num_states, num_states))
    observed = np.zeros((num_actions, num_states, num_outcomes + 1))
    rewards = np.zeros((num_actions, num_states))
    transitions[:num_poses] = np.eye(num_states)
    transitions[num_poses:, :, end] = 1.0
    observed[:, :, num_outcomes] = 1.0
    rewards[:num_poses, :end] = -problem.touch_cost
    for number, stage in enumerate(stages.stages):
        here = slice(starts[number], starts[number + 1])
        observed[:num_poses, here, :num_outcomes] = stages.likelihoods(number)
        observed[:num_poses, here, num_outcomes] = 0.0
        rewards[num_poses, here], rewards[num_poses + 1, here] = stage.confirm, stage.reject
        if stage.moves is not None:
            transitions[num_poses + 1, here, end] = 0.0
            transitions[num_poses + 1, here, starts[number + 1] : starts[number + 2]] = stage.moves
    return TabularPomdp(
        float(problem.discount),
        states,
        actions,
        observations,
        np.concatenate([stages.initial, np.zeros(num_states - sizes[0])]),
        transitions,
        observed,
        rewards,
        tuple(chain(*labels)),
    )


def to_pomdp(
    problem: TouchProblem | SearchTouchProblem,
    shape_labels: Sequence[str] | None = None,
    pose_labels: Sequence[str] | None = None,
) -> str:
    """The text of a ``.pomdp`` file; arguments and errors are those of :func:`as_pomdp`.

    Numbers are exact.
    """
    pomdp = as_pomdp(problem, shape_labels, pose_labels)
    legal = (*pomdp.states, *pomdp.actions, *pomdp.observations)
    lines = [
        "# Is it the target? States stay as they are while probed; the last state is terminal.",
        *(f"# {new} stands for {old!a}" for old, new in zip(pomdp.plain, legal, strict=True) if old != new),
        f"discount: {pomdp.discount!r}",
        "values: reward",
        f"states: {' '.join(pomdp.states)}",
        f"actions: {' '.join(pomdp.actions)}",
        f"observations: {' '.join(pomdp.observations)}",
        f"start: {_row(pomdp.start)}",
    ]
    for index, action in enumerate(pomdp.actions):
        lines += [f"T: {action}", *map(_row, pomdp.transitions[index])]
        lines += [f"O: {action}", *map(_row, pomdp.observation_probs[index])]
        lines += [
            f"R: {action} : {state} : * : * {reward!r}"
            for state, reward in zip(pomdp.states, pomdp.rewards[index].tolist(), strict=True)
        ]
    return "\n".join(lines) + "\n"


def legal_labels(labels: Sequence[str]) -> tuple[str, ...]:
    """Different labels of letters, digits, ``-`` and ``_`` that begin with a letter, as all parsers require.

    Words of the format are no labels.

    >>> legal_labels(["cube face", "cube.face", "45°", "reset"])
    ('cube_face', 'cube_face_2', 'x45_', 'xreset')
    """
    legal: list[str] = []
    for label in labels:
        plain = re.sub(r"[^A-Za-z0-9_-]", "_", label)
        plain = plain if re.match(r"[A-Za-z]", plain) and plain not in _RESERVED else f"x{plain}"
        unique, number = plain, 1
        while unique in legal:
            number += 1
            unique = f"{plain}_{number}"
        legal.append(unique)
    return tuple(legal)


def _plain_labels(
    problem: TouchProblem | SearchTouchProblem,
    stages: StagedProblem,
    shape_labels: Sequence[str] | None,
    pose_labels: Sequence[str] | None,
) -> tuple[list[str], list[str], list[str]]:
    """Labels of states, actions and observations, which the format may not allow."""
    num_poses, num_shapes, num_outcomes = problem.outcome_probs.shape
    shapes, poses = _names(shape_labels, num_shapes, "shape"), _names(pose_labels, num_poses, "pose")
    places = [f"object_{number}_" for number in range(len(stages.stages))] if len(stages.stages) > 1 else [""]
    states = [place + shapes[k] for place, stage in zip(places, stages.stages, strict=True) for k in stage.shapes]
    return (
        [*states, "end"],
        [*(f"probe_{pose}" for pose in poses), "confirm", "reject"],
        [*(f"outcome_{outcome}" for outcome in range(num_outcomes)), "nothing"],
    )


def _names(labels: Sequence[str] | None, size: int, kind: str) -> Sequence[str]:
    names = labels if labels is not None else [f"{kind}_{index}" for index in range(size)]
    if len(names) != size:
        raise InvalidArgument(f"there are {size} {kind}s, names are {list(names)}")
    return names


def _row(values: Floats) -> str:
    return " ".join(map(repr, values.tolist()))
