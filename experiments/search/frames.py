"""Frames of a recorded search: its touches are pressed again from the episode's seed and give the same images."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief import Confirm, Probe, Reject, SearchProblem
from belief.problem import Action
from belief.seeding import touch_rng
from experiments.search.setting import Setting, load_sensor, make_world
from planners import Episode, Step


@dataclass(frozen=True, eq=False)
class Frame:
    """One decision of a replayed search.

    Attributes:
        step: decision and the belief before it.
        shape: true shape of the object.
        image: reading of the tactile sensor, uint8; None where nothing was touched.
        posterior: belief about the object after the step, ``(K,)``.
    """

    step: Step
    shape: int
    image: NDArray[np.uint8] | None
    posterior: NDArray[np.float64]


def action_words(action: Action, problem: SearchProblem) -> str:
    """An action as a reader sees it: "touch corner", "confirm" or "reject"."""
    if isinstance(action, Probe):
        return f"touch {problem.pose_labels[action.pose]}"
    return "confirm" if isinstance(action, Confirm) else "reject"


def replay(setting: Setting, episode: Episode) -> list[Frame]:
    """Press the touches of an episode again and return its frames.

    Args:
        setting: that of the run.
        episode: a search of the run.
    """
    world = make_world(setting, load_sensor(setting), episode.seed)
    uses: Counter[tuple[int, int]] = Counter()
    frames = []
    for number, step in enumerate(episode.steps):
        image, posterior = None, step.belief.probs
        if isinstance(step.decision.action, Probe) and step.touch is not None:
            pose = step.decision.action.pose
            rng = touch_rng(episode.seed, step.object_index, pose, uses[step.object_index, pose])
            image, _ = world.press(pose, rng)
            uses[step.object_index, pose] += 1
            posterior = episode.steps[number + 1].belief.probs  # a touch is always followed by a decision
        elif isinstance(step.decision.action, Reject) and number + 1 < len(episode.steps):
            world.advance()
        frames.append(Frame(step, episode.arrangement[step.object_index], image, posterior))
    return frames
