"""Write a scene's search in Cassandra's ``.pomdp`` format, which SARSOP, pomdp-solve and POMDPs.jl read.

Run: python benchmarks/pomdp_files.py --scene coarse --target cone --objects 1 --discount 0.999 --out cone.pomdp

A file holds the discount, states, actions, observations, the start, and full tables T(s' | a, s), O(o | a, s') and
R(s, a), with exact numbers. The states are those of :mod:`planners.touch_problem` and a terminal one with reward zero.
Searches have discount 1; SARSOP and others need less, such as 0.999. The value that our solver finds is printed.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import numpy as np

from activetouch import TactileSensor
from belief.composition import Composition
from planners.solve import SearchTouchProblem, TouchProblem, solve
from planners.touch_problem import staged

MOST = 4_000_000  # numbers in a file


def pomdp_text(problem: TouchProblem | SearchTouchProblem, shape_labels: tuple[str, ...]) -> str:
    """The text of a file; too large a problem raises ValueError."""
    stages = staged(problem)
    num_poses, _, num_outcomes = problem.outcome_probs.shape
    sizes = [len(stage.shapes) for stage in stages.stages]
    num_states, num_actions = sum(sizes) + 1, num_poses + 2
    if num_actions * num_states * (num_states + num_outcomes + 1) > MOST:
        raise ValueError(f"{num_states} states make a file of more than {MOST} numbers; write fewer objects")
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
    named = [f"object_{i}_{shape_labels[k]}" for i, stage in enumerate(stages.stages) for k in stage.shapes]
    states = [f"s{i}_{re.sub('[^A-Za-z0-9_-]', '_', name)}" for i, name in enumerate(named)]  # unique, and no keyword
    actions = [*(f"probe_{pose}" for pose in range(num_poses)), "confirm", "reject"]
    lines = [
        f"discount: {float(problem.discount)!r}",
        "values: reward",
        f"states: {' '.join([*states, 'end'])}",
        f"actions: {' '.join(actions)}",
        f"observations: {' '.join([*(f'outcome_{i}' for i in range(num_outcomes)), 'nothing'])}",
        f"start: {_row(np.concatenate([stages.initial, np.zeros(num_states - sizes[0])]))}",
    ]
    for action, moves, seen, paid in zip(actions, transitions, observed, rewards, strict=True):
        lines += [f"T: {action}", *map(_row, moves), f"O: {action}", *map(_row, seen)]
        states_paid = zip([*states, "end"], paid.tolist(), strict=True)
        lines += [f"R: {action} : {state} : * : * {reward!r}" for state, reward in states_paid]
    return "\n".join(lines) + "\n"


def _row(values: np.ndarray) -> str:
    return " ".join(map(repr, values.tolist()))


def main() -> None:
    """Write the file, and print the value that our solver finds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="coarse")
    parser.add_argument("--target", default="cone")
    parser.add_argument("--objects", type=int, default=1)
    parser.add_argument("--touch-cost", type=float, default=0.02)
    parser.add_argument("--discount", type=float, default=1.0)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    model = TactileSensor.shipped(given.scene).model
    labels, table = model.shape_labels, model.outcome_table().probs
    rules = labels.index(given.target), given.touch_cost
    problem = SearchTouchProblem(table, given.objects, Composition.DISTINCT, *rules, discount=given.discount)
    given.out.write_text(pomdp_text(problem, labels), encoding="utf-8", newline="\n")
    print(f"wrote {given.out}; the value is at least {solve(problem).lower_bound:.4f} by our solver")


if __name__ == "__main__":
    main()
