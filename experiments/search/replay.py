"""See a recorded search again: its touches are pressed anew from the episode's seed, and come out the same."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from belief import Confirm, Probe, Reject, SearchProblem
from belief.errors import ActiveTouchError
from belief.files import atomic_path, require_writable_file
from belief.problem import Action
from belief.seeding import touch_rng
from experiments.command_line.arguments import CountOrNone, Ending, check_arguments
from experiments.search.run_folder import RunFolder, read_episode
from experiments.search.setting import Setting, load_sensor, make_world
from planners import Episode, Step

_ANIMATED = (".gif", ".webp")


@dataclass(frozen=True, eq=False)
class Frame:
    """One decision of a replayed search.

    Attributes:
        step: what was decided, on which belief.
        shape: true shape of the object.
        image: what the probe felt, uint8; None where nothing was touched.
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
    """The frames of an episode, its touch images pressed again."""
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


class NoSuchEpisode(ActiveTouchError, FileNotFoundError):
    """A folder does not hold the search that was asked for."""


@dataclass(frozen=True)
class Replay:
    """Draw one recorded search: touch images, belief after each touch, decisions; as a picture or animated.

    For example:

        activetouch replay --folder runs/compare --decider information_gain --target cone --number 3 --out search.png
        activetouch replay --target cone --out search.gif
    """

    folder: Path = Path("runs/compare")
    """Folder of a finished comparison."""
    decider: str = "information_gain"
    """Who searched."""
    target: str = "cone"
    """For what."""
    number: CountOrNone = 0
    """Which of its episodes, from 0."""
    out: Annotated[Path, Ending((".png", ".svg", ".pdf", *_ANIMATED))] = Path("runs/search.png")
    """Picture to write; the ending decides the format: .png, .svg, .pdf, or .gif and .webp for an animation."""

    def run(self) -> None:
        """Press the touches again and draw."""
        check_arguments(self)
        from experiments.search.replay_figures import animate_search, draw_search

        require_writable_file(self.out)
        run = RunFolder(self.folder)
        setting = Setting.from_dict(run.read_run()["arguments"]["setting"])
        episode = read_episode(self._line(run), tuple(setting.problem.shape_labels))
        draw = animate_search if self.out.suffix in _ANIMATED else draw_search
        with atomic_path(self.out) as temporary:
            draw(episode, replay(setting, episode), setting.problem, temporary)
        print(f"wrote {self.out}")

    def _line(self, run: RunFolder) -> str:
        """The search, as its folder has it."""
        there: dict[tuple[str, str], list[int]] = {}
        for key in run.complete_keys():
            if key.is_played:
                numbers = key.episodes(len(run.lines(key)))
                if (key.decider, key.target) == (self.decider, self.target) and self.number in numbers:
                    return run.lines(key)[self.number - numbers.start]
                there.setdefault((key.decider, key.target), []).extend(numbers)
        numbers = sorted(there.get((self.decider, self.target), []))
        if numbers:
            raise NoSuchEpisode(
                f"--number {self.number}: {self.folder} holds {len(numbers)} searches of {self.decider} for a "
                f"{self.target}, numbers {numbers[0]} to {numbers[-1]}. To play more, repeat the command that played "
                f"them with --episodes {max(self.number, 0) + 1}"
            )
        held = ", ".join(f"{decider} for {target}" for decider, target in there) or "none"
        raise NoSuchEpisode(
            f"{self.folder} holds no searches of {self.decider!r} for {self.target!r}. It holds: {held}. Name one with "
            "--decider and --target"
        )
