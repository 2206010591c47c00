"""``activetouch replay``: draw a recorded search, or animate it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from belief.constraints import Ending
from belief.errors import ActiveTouchError
from belief.files import atomic_path, require_writable_file
from experiments.command_line.arguments import BadArgument, CountOrNone, Trust, check_arguments
from experiments.search.play import Setting
from experiments.search.run import RunFolder, read_episode
from planners import Episode


class NoSuchEpisode(ActiveTouchError, FileNotFoundError):
    """The folder does not hold the requested search."""


@dataclass(frozen=True)
class Replay:
    """Draw the touch images, beliefs and decisions of a recorded search.

    For example:

        activetouch replay --folder runs/compare --decider information_gain --target cone --number 3 --out search.png
        activetouch replay --folder runs/compare --target cone --out search.webp
    """

    folder: Path = Path("runs/compare")
    """Folder of a finished comparison."""
    decider: str = "information_gain"
    """Decider of the search."""
    target: str = "cone"
    """Target of the search."""
    number: CountOrNone = 0
    """Number of the episode, from 0."""
    out: Annotated[Path, Ending((".png", ".svg", ".pdf", ".webp", ".gif"))] = Path("runs/search.png")
    """File to write. The ending decides the format: .png, .svg or .pdf, or .webp or .gif for an animation."""
    dark: bool = False
    """Draw an animation on a dark ground."""
    trust: bool = False
    """Run code of your own that the folder names, such as a scene module:attribute."""

    def run(self) -> None:
        """Repeat the touches and draw the search."""
        check_arguments(self)
        is_film = self.out.suffix.lower() in (".webp", ".gif")
        if self.dark and not is_film:
            raise BadArgument("--dark is the ground of an animation; add --out FILE.webp or FILE.gif")
        from activetouch.view import Bodies
        from experiments.search.play import replay
        from experiments.search.replay_figures import draw_search

        require_writable_file(self.out)
        run = RunFolder(self.folder).read_run()
        setting = Setting.from_dict(run["arguments"].get("setting"), Trust(self.folder, everything=self.trust))
        sensor, problem = setting.open_sensor(), setting.problem
        episode = self._episode(tuple(problem.shape_labels))
        if is_film:
            from experiments.search.film import DARK, LIGHT, write_film

            write_film(sensor, problem, episode, self.out, DARK if self.dark else LIGHT)
        else:
            with atomic_path(self.out) as temporary:
                frames = replay(sensor, problem, episode)
                draw_search(episode, frames, problem, temporary, Bodies.of(sensor), sensor.scene)
        print(f"wrote {self.out}")

    def _episode(self, labels: tuple[str, ...]) -> Episode:
        """The requested search."""
        held, wanted = RunFolder(self.folder).latest(labels), (self.decider, self.target)
        if numbers := [json.loads(line)["seed"][-1] for line in held.get(wanted, ())]:
            if self.number in numbers:
                return read_episode(held[wanted][numbers.index(self.number)], labels)
            more = RunFolder(self.folder).command("compare", config=self.folder / "run.json", episodes=self.number + 1)
            raise NoSuchEpisode(
                f"--number {self.number}: {self.folder} holds {len(numbers)} searches of {self.decider} for "
                f"{self.target}, numbers {numbers[0]} to {numbers[-1]}. For more searches, run:\n{more}"
            )
        others = ", ".join(f"{decider} for {target}" for decider, target in held) or "none"
        raise NoSuchEpisode(
            f"{self.folder} holds no searches of {self.decider!r} for {self.target!r}. Choose --decider and --target "
            f"from what it holds: {others}"
        )
