"""The paper's Table 2, how often its rule and its PPO policies find each shape, beside the same deciders here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from activetouch.world import POLICIES
from belief.errors import ActiveTouchError
from belief.statistics import wilson_interval
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.setting import Setting
from experiments.sensor_choice import policy_commands
from planners.ppo import load_ppo_policy
from planners.registry import TRAINED

PAPER: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "Manual": {"sphere": 1.00, "cube": 1.00, "cylinder": 0.05, "cone": 0.08},
        "PPO": {"sphere": 0.46, "cube": 0.13, "cylinder": 0.15, "cone": 0.20},
    }
)
"""Table 2 as printed: success over 100 trials of each target."""
PAPER_TRIALS = 100
_STATES = {"ppo": "paper", "ppo_confident": "paper", "ppo_posterior": "posterior"}


@dataclass(frozen=True)
class Column:
    """One decider in one scene.

    Attributes:
        scene, decider: which.
        successes: by target.
        trials: of each target.
        touches: of a search, on average over the targets.
        floor: best success without a touch, on average over the targets.
        ceiling: searches that full information solves, and on how many that was tried.
        missing: why there is nothing; empty where there is.
    """

    scene: str
    decider: str
    successes: Mapping[str, int]
    trials: int
    touches: float = 0.0
    floor: float = 0.0
    ceiling: tuple[int, int] = (0, 0)
    missing: str = ""

    @property
    def name(self) -> str:
        """Who searched where."""
        return f"{self.decider}, {self.scene}"

    @property
    def cells(self) -> list[str]:
        """Success by target and over all, touches, floor and ceiling."""
        if self.missing:
            return ["–"] * (len(PAPER["PPO"]) + 4)
        by_target = [_success(self.successes[target], self.trials) for target in PAPER["PPO"]]
        over_all = _success(sum(self.successes.values()), len(self.successes) * self.trials, digits=3)
        solved, tried = self.ceiling
        return [*by_target, f"**{over_all}**", f"{self.touches:.1f}", f"{self.floor:.2f}", f"{solved}/{tried}"]


def search_columns(
    scenes: Mapping[str, Path | None], deciders: Sequence[str], episodes: int, seed: int, folder: Path, jobs: int
) -> list[Column]:
    """Play live searches with every decider in every scene; what was played before is kept.

    Args:
        scenes: folder of the sensor by scene; the shipped one where there is none.
        deciders: whom; those without the policies they need are said to be missing.
        episodes: searches for each target.
        seed: of the episodes.
        folder: of the runs, one a scene.
        jobs: processes.
    """
    columns = []
    for scene, sensor in scenes.items():
        setting = Setting(SceneChoice(scene), sensor=sensor)
        targets = [shape for shape in PAPER["PPO"] if shape in setting.problem.shape_labels]
        missing = {name: _missing(name, setting, targets) for name in deciders}
        able = tuple(name for name in deciders if not missing[name])
        played = Compare(
            able, None, tuple(targets), episodes, seed, setting, out=folder / scene, bound=False, jobs=jobs
        )
        comparison = played.play()
        cells = comparison.cells
        for name in deciders:
            if missing[name]:
                columns.append(Column(scene, name, {}, 0, missing=missing[name]))
            else:
                successes = {target: cells[name, target].successes for target in targets}
                touches = cells[name, "all"].touches
                columns.append(Column(scene, name, successes, episodes, touches, comparison.floor, comparison.ceiling))
    return columns


def _missing(decider: str, setting: Setting, targets: Sequence[str]) -> str:
    """Why a decider cannot search, in words; empty if it can."""
    if decider not in TRAINED:
        return ""
    try:
        for target in targets:
            load_ppo_policy(setting.sensor_folder / POLICIES, _STATES[decider], target)
    except ActiveTouchError as error:
        commands = policy_commands(setting.choice.scene, setting.sensor_folder)
        return f"{error}. To train policies for this sensor: {' && '.join(commands.splitlines())}"
    return ""


def to_markdown(columns: Sequence[Column]) -> str:
    """The paper's table with ours below it, turned on its side, and below it what could not be played."""
    lines = [["decider, scene", *PAPER["PPO"], "all", "touches a search", "floor", "ceiling"]]
    lines.append(["---"] * len(lines[0]))
    for name, printed in PAPER.items():
        mean = sum(printed.values()) / len(printed)
        lines.append([f"paper: {name}", *(f"{value:.2f}" for value in printed.values()), f"**{mean:.3f}**", "", "", ""])
    lines += [[column.name, *column.cells] for column in columns]
    notes = [f"{column.name} is not available: {column.missing}." for column in columns if column.missing]
    return "\n".join([*("| " + " | ".join(line) + " |" for line in lines), *("\n" + note for note in notes)]) + "\n"


def _success(successes: int, trials: int, digits: int = 2) -> str:
    low, high = wilson_interval(successes, trials)
    return f"{successes / trials:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def to_numbers(columns: Sequence[Column]) -> list[dict[str, Any]]:
    """The same for machines."""
    return [
        {
            "scene": column.scene,
            "decider": column.decider,
            "trials": column.trials,
            "successes": dict(column.successes),
            "touches": column.touches,
            "floor": column.floor,
            "ceiling": column.ceiling,
            "missing": column.missing,
        }
        for column in columns
    ]
