"""See a recorded search again: its touches are pressed anew from the episode's seed, and come out the same."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activetouch.atomic import atomic_path
from belief import Probe
from experiments.episodes import Setting, load_sensor, make_world
from experiments.results import RunFolder
from planners import Episode, Step
from planners.search import touch_rng


@dataclass(frozen=True, eq=False)
class Frame:
    """One decision of a replayed search.

    Attributes:
        step: what was decided, on which belief.
        shape: true shape of the object.
        image: what the probe felt, uint8; None for CONFIRM and REJECT.
        posterior: belief about the object after the step, ``(K,)``.
    """

    step: Step
    shape: int
    image: NDArray[np.uint8] | None
    posterior: NDArray[np.float64]


def replay(setting: Setting, episode: Episode) -> list[Frame]:
    """The frames of an episode, its touch images pressed again."""
    world = make_world(setting, load_sensor(setting), episode.seed)
    uses: Counter[tuple[int, int]] = Counter()
    frames = []
    for number, step in enumerate(episode.steps):
        image, posterior = None, step.belief.probs
        if isinstance(step.decision.action, Probe):
            pose = step.decision.action.pose
            rng = touch_rng(episode.seed, step.object_index, pose, uses[step.object_index, pose])
            image = world.press(pose, rng)
            uses[step.object_index, pose] += 1
            if number + 1 < len(episode.steps):  # the next decision is about the same object
                posterior = episode.steps[number + 1].belief.probs
        elif number + 1 < len(episode.steps):
            world.advance()
        frames.append(Frame(step, episode.arrangement[step.object_index], image, posterior))
    return frames


@dataclass(frozen=True)
class Replay:
    """Draw one recorded search: touch images, belief after each touch, decisions.

    For example:

        activetouch replay --folder runs/compare --decider information_gain --target cone --number 3 --out search.png
    """

    folder: Path = Path("runs/compare")
    """Folder of a finished comparison."""
    decider: str = "information_gain"
    """Who searched."""
    target: str = "cone"
    """For what."""
    number: int = 0
    """Which of its episodes, from 0."""
    out: Path = Path("runs/search.png")
    """Picture to write; the ending decides the format."""

    def run(self) -> None:
        """Press the touches again and draw."""
        from experiments.figures import draw_search

        run = RunFolder(self.folder)
        setting = Setting.from_dict(run.read_run()["setting"])
        for episode in run.all_episodes(tuple(setting.problem.shape_labels), self.decider, self.target):
            if episode.seed[-1] == self.number:
                with atomic_path(self.out) as temporary:
                    draw_search(episode, replay(setting, episode), setting.problem, temporary)
                print(f"wrote {self.out}")
                return
        raise SystemExit(f"{self.folder} has no episode {self.number} of {self.decider} searching for a {self.target}")
