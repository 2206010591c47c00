"""``activetouch compare``: live searches, the same ones for every decider, and a report."""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from activetouch.world import CLASSIFIER_FILE, OBSERVATION_FILE
from belief import SearchProblem
from belief.errors import ActiveTouchError, UnknownName
from experiments.ceiling import full_information_successes
from experiments.episodes import Setting, play
from experiments.parallel import default_jobs, run_tasks
from experiments.results import EPISODES_PER_SHARD, RunFolder, Seconds, ShardKey, read_episode
from experiments.summary import Comparison, compare_episodes
from planners import DECIDERS

_CEILING_EPISODES = 50  # per target; each costs one touch for every object and pose


class BadArgument(ActiveTouchError, ValueError):
    """A command was asked for something that makes no sense."""


@dataclass(frozen=True)
class Compare:
    """Search live in MuJoCo with several deciders on identical episodes; print a table, write a report.

    Finished episodes are kept: interrupt with Ctrl-C whenever you like, the same command goes on from there, and a
    larger ``--episodes`` extends a finished run.

    For example:

        activetouch compare
        activetouch compare --deciders threshold information_gain --targets cone --episodes 1000 --out runs/cone
        activetouch compare --scene coarse
    """

    deciders: tuple[str, ...] = ("information_gain", "threshold", "random_confirm")
    """Who searches; differences are taken to the first."""
    targets: tuple[str, ...] = ()
    """Shapes to search for; all by default."""
    episodes: int = 250
    """Searches per decider and target."""
    seed: int = 0
    """Of the whole comparison."""
    setting: Annotated[Setting, tyro.conf.arg(name="")] = field(default_factory=Setting)
    """What the episodes have in common."""
    out: Path | None = None
    """Folder of the run; runs/compare, or runs/compare-SCENE for another scene than gel, by default."""
    jobs: int = field(default_factory=default_jobs)
    """Processes; the results do not depend on it."""

    @property
    def folder(self) -> Path:
        """Where the run is kept."""
        scene = self.setting.choice.scene
        return self.out if self.out is not None else Path("runs/compare" if scene == "gel" else f"runs/compare-{scene}")

    def run(self) -> None:
        """Play what is missing, then summarise everything."""
        from experiments.report import write_report  # loads matplotlib

        comparison = self.play()
        console = Console()
        console.print(render_table(comparison))
        for line in describe_differences(comparison):
            console.print(line)
        report = write_report(self.folder, comparison, self.setting, self.seed)
        console.print(f"report: {report}", soft_wrap=True)

    def play(self) -> Comparison:
        """Play what is missing and read everything back.

        Raises:
            BadArgument: there is nothing to play, or no such search.
            UnknownName: a decider or target that does not exist.
            RunMismatch: the folder holds another run.
        """
        problem, targets = self._check()
        labels = list(problem.shape_labels)
        folder, shards = RunFolder(self.folder), range(math.ceil(self.episodes / EPISODES_PER_SHARD))
        keys = [ShardKey(d, t, n) for d in dict.fromkeys(self.deciders) for t in targets for n in shards]
        num_ceiling = min(self.episodes, _CEILING_EPISODES)
        warning = folder.open(self._identity(), self._arguments())
        if warning:
            print(warning, file=sys.stderr)
        tasks: list[Callable[[], None]] = [
            partial(_play_shard, folder, key, self.setting, labels.index(key.target), self.seed)
            for key in keys
            if not folder.has(key)
        ]
        tasks += [
            partial(_play_ceiling, folder, target, self.setting, labels.index(target), self.seed, num_ceiling)
            for target in targets
            if not folder.has_ceiling(target, num_ceiling)
        ]
        for _ in run_tasks(tasks, self.jobs, "searching"):
            pass
        lines: dict[tuple[str, str], list[str]] = {}
        seconds: dict[tuple[str, str], Seconds] = {}
        for key in keys:
            cell = (key.decider, key.target)
            lines[cell] = (lines.get(cell, []) + folder.lines(key))[: self.episodes]
            seconds[cell] = seconds.get(cell, Seconds()) + folder.seconds(key)
        folder.merge(chain.from_iterable(lines.values()))
        episodes = {cell: [read_episode(line, tuple(labels)) for line in some] for cell, some in lines.items()}
        ceiling = (sum(folder.read_ceiling(target, num_ceiling) for target in targets), num_ceiling * len(targets))
        rng = np.random.default_rng(self.seed)
        return compare_episodes(problem, episodes, seconds, ceiling, self.deciders[0], rng)

    def _check(self) -> tuple[SearchProblem, list[str]]:
        """The search and the targets, or an error before anything is started or written."""
        try:
            problem = self.setting.problem
        except ValueError as error:
            raise BadArgument(str(error)) from error
        if not self.setting.sensor_folder.is_dir():
            raise BadArgument(
                f"{self.setting.sensor_folder} holds no sensor; make one for this scene with activetouch collect, "
                "train and calibrate, and name its folder with --sensor"
            )
        if self.episodes < 1 or self.jobs < 1 or not self.deciders:
            raise BadArgument("--episodes and --jobs must be at least 1, and --deciders must name one")
        for name in self.deciders:
            if name not in DECIDERS:
                raise UnknownName("decider", name, list(DECIDERS))
        for target in self.targets:
            if target not in problem.shape_labels:
                raise UnknownName("target", target, list(problem.shape_labels))
        return problem, list(dict.fromkeys(self.targets or problem.shape_labels))

    def _identity(self) -> dict[str, object]:
        """What decides an episode; the sensor by content, wherever it lies."""
        digest = hashlib.sha256()
        for name in (CLASSIFIER_FILE, OBSERVATION_FILE):
            digest.update((self.setting.sensor_folder / name).read_bytes())
        problem = repr(self.setting.problem)
        scene = repr(self.setting.scene)
        return {"seed": self.seed, "problem": problem, "scene": scene, "sensor_sha256": digest.hexdigest()}

    def _arguments(self) -> dict[str, object]:
        return {**asdict(self), "out": str(self.folder), "setting": self.setting.to_dict()}


def _play_ceiling(folder: RunFolder, label: str, setting: Setting, target: int, seed: int, episodes: int) -> None:
    folder.write_ceiling(label, full_information_successes(setting, target, seed, range(episodes)), episodes)


def _play_shard(folder: RunFolder, key: ShardKey, setting: Setting, target: int, seed: int) -> None:
    try:
        episodes, seconds = play(setting, key.decider, target, seed, key.episodes)
    except ActiveTouchError as error:
        error.add_note(f"in one of the episodes {key.episodes} of {key.decider}, target {key.target}, seed {seed}")
        raise
    folder.write_shard(key, episodes, seconds)


def render_table(comparison: Comparison) -> Table:
    """The comparison as a table that fits an 80-column terminal."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), caption_justify="left")
    table.caption = (
        f"{next(iter(comparison.cells.values())).num_episodes} live searches per decider and target, 95 % Wilson "
        f"intervals. Floor (without touching) {comparison.floor:.2f}; ceiling (touch everything first) "
        f"{comparison.ceiling[0]}/{comparison.ceiling[1]}. ms/touch = physics+network+decision"
    )
    for heading in ("target", "success", "95 %", "wrong", "none", "touches", "ms/touch"):
        table.add_column(heading, justify="left" if heading == "target" else "right", no_wrap=True)
    for decider in comparison.deciders:
        table.add_row(decider, style="bold")
        for target in [*comparison.targets, "all"]:
            cell = comparison.cells[decider, target]
            low, high = cell.success_interval
            ms = cell.seconds.ms_per_touch()
            table.add_row(
                f"  {target}",
                f"{cell.success:.3f}",
                f"{low:.3f}–{high:.3f}",
                str(cell.wrong),
                str(cell.none + cell.truncated),
                f"{cell.touches:.2f}",
                f"{ms['physics']:.1f}+{ms['network']:.1f}+{ms['decision']:.1f}" if cell.touches else "–",
                end_section=target == "all",
            )
    return table


def describe_differences(comparison: Comparison) -> list[str]:
    """One sentence for each decider that is compared with the reference, and on presses that were made again."""
    lines = []
    for name, difference in comparison.differences.items():
        mean, low, high = difference.success
        touches, touches_low, touches_high = difference.touches
        lines.append(
            f"{name} against {comparison.reference}, paired over the same episodes: success {mean:+.3f} "
            f"[{low:+.3f}, {high:+.3f}], touches {touches:+.2f} [{touches_low:+.2f}, {touches_high:+.2f}]"
        )
    if comparison.pressed_again:
        lines.append(f"{comparison.pressed_again} presses did not settle and were made again")
    return lines
