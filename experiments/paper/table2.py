"""The paper's Table 2: success by target of its manual rule and PPO, and of the same deciders here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from types import MappingProxyType

from belief.statistics import wilson_interval
from belief.table import Table, Value, interval
from experiments.search.comparison import compare
from experiments.search.summary import ALL

SCENE = "paper"
"""Scene of the searches: images like the paper's."""
DECIDERS = ("threshold", "ppo", "ppo_confident", "ppo_posterior", "point_based")
"""The paper's manual rule, its PPO, its recommendation; and two of ours."""
PAPER: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "Manual": {"sphere": 1.00, "cube": 1.00, "cylinder": 0.05, "cone": 0.08},
        "PPO": {"sphere": 0.46, "cube": 0.13, "cylinder": 0.15, "cone": 0.20},
    }
)
"""Table 2 as printed: success over 100 trials of each target."""


@dataclass(frozen=True)
class Column:
    """Results of one decider.

    Attributes:
        scene: name of the scene.
        decider: name of the decider.
        successes: number of successful searches by target.
        trials: searches per target.
        touches: mean number of touches per search.
        no_touch_baseline: highest success rate without a touch, mean over the targets.
    """

    scene: str
    decider: str
    successes: Mapping[str, int]
    trials: int
    touches: float
    no_touch_baseline: float


def search_columns(sensor: Path, episodes: int, seed: int, folder: Path, jobs: int) -> list[Column]:
    """Play live searches with every decider and a sensor with policies; finished searches are kept in a folder."""
    targets = tuple(PAPER["PPO"])
    found = compare(
        SCENE, DECIDERS, episodes=episodes, seed=seed, targets=targets, sensor=sensor, out=folder, jobs=jobs
    )
    return [
        Column(
            SCENE,
            name,
            {target: found.cells[name, target].successes for target in targets},
            episodes,
            found.cells[name, ALL].touches,
            found.no_touch_baseline,
        )
        for name in DECIDERS
    ]


def table(columns: Sequence[Column]) -> Table:
    """The paper's Table 2 transposed, with our results below it."""
    rows: list[Sequence[Value]] = [
        (f"paper: {name}", *(f"{value:.2f}" for value in printed.values()), f"{fmean(printed.values()):.3f}", *[""] * 2)
        for name, printed in PAPER.items()
    ]
    for column in columns:
        by_target = [_success(column.successes[target], column.trials) for target in PAPER["PPO"]]
        over_all = _success(sum(column.successes.values()), len(column.successes) * column.trials, ".3f")
        rest = (f"{column.touches:.1f}", f"{column.no_touch_baseline:.2f}")
        rows.append((f"{column.decider}, {column.scene}", *by_target, over_all, *rest))
    return Table(
        "",
        ["decider, scene", *PAPER["PPO"], "all", "touches per search", "no-touch baseline"],
        rows,
    )


def _success(successes: int, trials: int, spec: str = ".2f") -> str:
    return interval(successes / trials, *wilson_interval(successes, trials), spec=spec)
