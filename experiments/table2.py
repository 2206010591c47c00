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
from experiments.compare import Compare
from experiments.episodes import Setting
from experiments.scene_choice import SceneChoice
from planners.ppo import load_policy
from planners.table import TRAINED

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
        missing: why there is nothing; empty where there is.
    """

    scene: str
    decider: str
    successes: Mapping[str, int]
    trials: int
    touches: float = 0.0
    missing: str = ""

    @property
    def name(self) -> str:
        """Heading."""
        return f"{self.decider}, {self.scene}"

    def cell(self, target: str) -> str:
        """Success with its 95 % Wilson interval."""
        if self.missing:
            return "–"
        low, high = wilson_interval(self.successes[target], self.trials)
        return f"{self.successes[target] / self.trials:.2f} [{low:.2f}, {high:.2f}]"


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
        cells = played.play().cells
        for name in deciders:
            if missing[name]:
                columns.append(Column(scene, name, {}, 0, missing=missing[name]))
            else:
                successes = {target: cells[name, target].successes for target in targets}
                columns.append(Column(scene, name, successes, episodes, cells[name, "all"].touches))
    return columns


def _missing(decider: str, setting: Setting, targets: Sequence[str]) -> str:
    """Why a decider cannot search, in words; empty if it can."""
    if decider not in TRAINED:
        return ""
    try:
        for target in targets:
            load_policy(setting.sensor_folder / POLICIES, _STATES[decider], target)
    except ActiveTouchError as error:
        return f"{error} --scene {setting.choice.scene}, and put its policies into {setting.sensor_folder / POLICIES}"
    return ""


def to_markdown(columns: Sequence[Column]) -> str:
    """The paper's table with ours beside it, and below it what could not be played."""
    headings = ["", *(f"paper: {name}" for name in PAPER), *(column.name for column in columns)]
    lines = [headings, ["---"] * len(headings)]
    for target in PAPER["PPO"]:
        printed = [f"{PAPER[name][target]:.2f}" for name in PAPER]
        lines.append([target, *printed, *(column.cell(target) for column in columns)])
    touches = ["–" if column.missing else f"{column.touches:.1f}" for column in columns]
    lines.append(["touches a search", "", "", *touches])
    notes = [f"{column.name} is not available: {column.missing}." for column in columns if column.missing]
    return "\n".join([*("| " + " | ".join(line) + " |" for line in lines), *("\n" + note for note in notes)]) + "\n"


def to_numbers(columns: Sequence[Column]) -> list[dict[str, Any]]:
    """The same for machines."""
    return [
        {
            "scene": column.scene,
            "decider": column.decider,
            "trials": column.trials,
            "successes": dict(column.successes),
            "touches": column.touches,
            "missing": column.missing,
        }
        for column in columns
    ]
