"""``activetouch compare``: live searches, the same ones for every decider, and a report."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from belief.errors import UnknownName
from experiments.ceiling import full_information_successes
from experiments.episodes import Setting, play
from experiments.parallel import default_jobs, run_tasks
from experiments.results import RunFolder, Seconds, ShardKey
from experiments.summary import Comparison, compare_episodes
from planners import DECIDERS

_EPISODES_PER_SHARD = 25
_CEILING_EPISODES = 50  # per target; each costs one touch for every object and pose


@dataclass(frozen=True)
class Compare:
    """Search live in MuJoCo with several deciders on identical episodes; print a table, write a report.

    Finished episodes are kept: interrupt with Ctrl-C whenever you like, the same command goes on from there, and a
    larger ``--episodes`` extends a finished run.

    For example:

        activetouch compare
        activetouch compare --deciders threshold information_gain --targets cone --episodes 1000 --out runs/cone
    """

    deciders: tuple[str, ...] = ("information_gain", "threshold", "random_confirm")
    """Who searches; differences are taken to the first."""
    targets: tuple[str, ...] = ()
    """Shapes to search for; all by default."""
    episodes: int = 250
    """Searches per decider and target."""
    seed: int = 0
    """Of the whole comparison."""
    setting: Setting = field(default_factory=Setting)
    """What the episodes have in common."""
    out: Path = Path("runs/compare")
    """Folder of the run."""
    jobs: int = field(default_factory=default_jobs)
    """Processes; the results do not depend on it."""

    def run(self) -> None:
        """Play what is missing, then summarise everything."""
        comparison = self.play()
        console = Console()
        console.print(render_table(comparison))
        for line in describe_differences(comparison):
            console.print(line)
        from experiments.report import write_report

        report = write_report(self.out, comparison, self.setting, self.seed)
        console.print(f"report: {report}")

    def play(self) -> Comparison:
        """Play what is missing and read everything back."""
        folder = RunFolder(self.out)
        folder.open(self._identity(), {"setting": {**asdict(self.setting), "sensor": str(self.setting.sensor)}})
        keys = list(self._keys())
        labels = list(self.setting.problem.shape_labels)
        tasks = [
            partial(_play_shard, folder, key, self.setting, labels.index(key.target), self.seed)
            for key in keys
            if not folder.has(key)
        ]
        tasks += [
            partial(_play_ceiling, folder, target, self.setting, labels.index(target), self.seed, self._num_ceiling)
            for target in dict.fromkeys(key.target for key in keys)
            if not folder.has_ceiling(target, self._num_ceiling)
        ]
        for _ in run_tasks(tasks, self.jobs, "searching"):
            pass
        folder.merge(keys)
        return self._read(folder, keys)

    def _keys(self) -> Iterator[ShardKey]:
        labels = list(self.setting.problem.shape_labels)
        for name in self.deciders:
            if name not in DECIDERS:
                raise UnknownName("decider", name, list(DECIDERS))
        for target in self.targets:
            if target not in labels:
                raise UnknownName("target", target, labels)
        if self.episodes < 1:
            raise ValueError(f"--episodes must be at least 1, got {self.episodes}")
        for decider in self.deciders:
            for target in self.targets or labels:
                for first in range(0, self.episodes, _EPISODES_PER_SHARD):
                    yield ShardKey(decider, target, first, min(first + _EPISODES_PER_SHARD, self.episodes))

    @property
    def _num_ceiling(self) -> int:
        return min(self.episodes, _CEILING_EPISODES)

    def _identity(self) -> dict[str, object]:
        """What decides an episode besides its seed; the sensor by content, wherever it lies."""
        digest = hashlib.sha256()
        for file in sorted(self.setting.sensor.iterdir()):
            if file.suffix in (".safetensors", ".json") and file.name != "evaluation.json":
                digest.update(file.read_bytes())
        setting = {name: value for name, value in asdict(self.setting).items() if name != "sensor"}
        scene = repr(self.setting.scene)
        return {"seed": self.seed, "setting": setting, "scene": scene, "sensor_sha256": digest.hexdigest()}

    def _read(self, folder: RunFolder, keys: list[ShardKey]) -> Comparison:
        problem = self.setting.problem
        episodes: dict[tuple[str, str], list] = {}
        seconds: dict[tuple[str, str], Seconds] = {}
        for key in keys:
            cell = (key.decider, key.target)
            episodes.setdefault(cell, []).extend(folder.episodes(key, tuple(problem.shape_labels)))
            seconds.setdefault(cell, Seconds()).__iadd__(folder.seconds(key))
        targets = dict.fromkeys(key.target for key in keys)
        solved = sum(folder.read_ceiling(target, self._num_ceiling) for target in targets)
        ceiling = (solved, self._num_ceiling * len(targets))
        rng = np.random.default_rng(self.seed)
        return compare_episodes(problem, episodes, seconds, ceiling, self.deciders[0], rng)


def _play_ceiling(folder: RunFolder, label: str, setting: Setting, target: int, seed: int, episodes: int) -> None:
    folder.write_ceiling(label, full_information_successes(setting, target, seed, range(episodes)), episodes)


def _play_shard(folder: RunFolder, key: ShardKey, setting: Setting, target: int, seed: int) -> None:
    episodes, seconds = play(setting, key.decider, target, seed, range(key.first, key.last))
    folder.write_shard(key, episodes, seconds)


def render_table(comparison: Comparison) -> Table:
    """The comparison as a table that fits an 80-column terminal."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), caption_justify="left")
    table.caption = (
        f"{next(iter(comparison.cells.values())).num_episodes} live searches per decider and target, 95 % Wilson "
        f"intervals. Floor (confirm at random) {comparison.floor:.2f}; ceiling (touch everything first) "
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
    """One sentence for each decider that is compared with the reference."""
    lines = []
    for name, difference in comparison.differences.items():
        mean, low, high = difference.success
        touches, touches_low, touches_high = difference.touches
        lines.append(
            f"{name} against {comparison.reference}, paired over the same episodes: success {mean:+.3f} "
            f"[{low:+.3f}, {high:+.3f}], touches {touches:+.2f} [{touches_low:+.2f}, {touches_high:+.2f}]"
        )
    return lines
