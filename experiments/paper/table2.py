"""The paper's Table 2: success by target of its manual rule and PPO, and of the same deciders here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from types import MappingProxyType

from activetouch.sensor_files import POLICIES
from belief.errors import ActiveTouchError
from belief.statistics import wilson_interval
from experiments.reporting.tables import Table, Value, interval
from experiments.scene_choice import SceneChoice, in_file_names
from experiments.search.compare import Compare
from experiments.search.setting import Setting
from experiments.search.summary import ALL
from experiments.sensor_choice import independent_sensor, policy_commands
from planners.ppo import load_ppo_policy
from planners.registry import trained_state

PAPER: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "Manual": {"sphere": 1.00, "cube": 1.00, "cylinder": 0.05, "cone": 0.08},
        "PPO": {"sphere": 0.46, "cube": 0.13, "cylinder": 0.15, "cone": 0.20},
    }
)
"""Table 2 as printed: success over 100 trials of each target."""


@dataclass(frozen=True)
class Column:
    """Results of one decider in one scene.

    Attributes:
        scene: name of the scene.
        decider: name of the decider.
        successes: number of successful searches by target.
        trials: searches per target.
        touches: mean number of touches per search.
        no_touch_baseline: highest success rate without a touch, mean over the targets.
        oracle: number of searches in which the full-information oracle succeeds, and on which it was run.
        missing: reason why there are no results; empty if there are.
    """

    scene: str
    decider: str
    successes: Mapping[str, int]
    trials: int
    touches: float = 0.0
    no_touch_baseline: float = 0.0
    oracle: tuple[int, int] = (0, 0)
    missing: str = ""

    @property
    def name(self) -> str:
        """Decider and scene."""
        return f"{self.decider}, {self.scene}"


def search_columns(
    scenes: Mapping[str, Path | None], deciders: Sequence[str], episodes: int, seed: int, folder: Path, jobs: int
) -> list[Column]:
    """Play live searches with every decider in every scene; finished searches are kept.

    Args:
        scenes: folder of the sensor by scene, all with the paper's shapes; None for the shipped one that reads shapes
            only.
        deciders: names of the deciders; one without the policies that it needs is reported as missing.
        episodes: searches per target.
        seed: seed of the episodes.
        folder: where the runs are kept, one subfolder per scene.
        jobs: number of processes.

    Raises:
        UnknownName: there is no such scene or decider.
        CannotWrite: there is no room, or no permission.
    """
    columns: list[Column] = []
    for scene, sensor in scenes.items():
        setting = Setting(SceneChoice(scene), sensor=sensor if sensor is not None else independent_sensor(scene))
        targets = list(PAPER["PPO"])
        missing = {name: _missing(name, setting, targets) for name in deciders}
        able = tuple(name for name in deciders if not missing[name])
        found = {name: Column(scene, name, {}, 0, missing=missing[name]) for name in deciders}
        if able:
            compare = Compare(
                able,
                None,
                tuple(targets),
                episodes,
                seed,
                setting,
                out=folder / in_file_names(scene),
                jobs=jobs,
            )
            comparison = compare.play()
            for name in able:
                successes = {target: comparison.cells[name, target].successes for target in targets}
                touches = comparison.cells[name, ALL].touches
                found[name] = Column(
                    scene, name, successes, episodes, touches, comparison.no_touch_baseline, comparison.oracle
                )
        columns += found.values()
    return columns


def _missing(decider: str, setting: Setting, targets: Sequence[str]) -> str:
    """Reason why a decider cannot search; empty if it can."""
    if (state := trained_state(decider)) is None:
        return ""
    try:
        for target in targets:
            load_ppo_policy(setting.sensor_folder / POLICIES, state, target)
    except ActiveTouchError as error:
        commands = policy_commands(setting.choice.scene, setting.sensor_folder, state)
        return f"{error}. To train policies for this sensor: {' && '.join(commands.splitlines())}"
    return ""


def table(columns: Sequence[Column]) -> Table:
    """The paper's Table 2 transposed, with our results below it; the note lists deciders without results."""
    rows: list[Sequence[Value]] = [
        (f"paper: {name}", *(f"{value:.2f}" for value in printed.values()), f"{fmean(printed.values()):.3f}", *[""] * 3)
        for name, printed in PAPER.items()
    ]
    for column in columns:
        if column.missing:
            rows.append((column.name, *["–"] * (len(PAPER["PPO"]) + 4)))
            continue
        by_target = [_success(column.successes[target], column.trials) for target in PAPER["PPO"]]
        over_all = _success(sum(column.successes.values()), len(column.successes) * column.trials, ".3f")
        rest = (f"{column.touches:.1f}", f"{column.no_touch_baseline:.2f}", f"{column.oracle[0]}/{column.oracle[1]}")
        rows.append((column.name, *by_target, over_all, *rest))
    note = "\n\n".join(f"{column.name} is not available: {column.missing}." for column in columns if column.missing)
    headings = ["decider, scene", *PAPER["PPO"], "all", "touches per search", "no-touch baseline", "oracle"]
    return Table("", headings, rows, note)


def _success(successes: int, trials: int, spec: str = ".2f") -> str:
    return interval(successes / trials, *wilson_interval(successes, trials), spec=spec)
