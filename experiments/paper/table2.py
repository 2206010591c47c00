"""The paper's Table 2 and Figure 3: success by target of its manual rule and PPO, and of the same deciders here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from belief.statistics import wilson_interval
from belief.table import Table, Value, interval
from experiments.paper import table1
from experiments.search.comparison import compare
from experiments.search.summary import ALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from experiments.report import Picture

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
    """Results of a decider: successes by target, of ``trials`` each, mean touches, and best success without a touch."""

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
    columns = []
    for name in DECIDERS:
        successes = {target: found.cells[name, target].successes for target in targets}
        columns.append(
            Column(SCENE, name, successes, episodes, found.cells[name, ALL].touches, found.no_touch_baseline)
        )
    return columns


def table(columns: Sequence[Column]) -> Table:
    """The paper's Table 2 transposed, with our results below it."""
    rows: list[Sequence[Value]] = [
        (f"paper: {name}", *(f"{value:.2f}" for value in printed.values()), f"{fmean(printed.values()):.3f}", *[""] * 2)
        for name, printed in PAPER.items()
    ]
    for column in columns:
        number, count = column.trials, column.successes
        cells = [(count[target], number, ".2f") for target in PAPER["PPO"]]
        cells.append((sum(count.values()), len(count) * number, ".3f"))
        shown = [interval(right / of, *wilson_interval(right, of), spec=spec) for right, of, spec in cells]
        rest = (f"{column.touches:.1f}", f"{column.no_touch_baseline:.2f}")
        rows.append((f"{column.decider}, {column.scene}", *shown, *rest))
    headings = ["decider, scene", *PAPER["PPO"], "all", "touches per search", "no-touch baseline"]
    return Table("", headings, rows, name="table2")


_GREYS = ("#999999", "#e6e6e6")  # of the paper's bars
_SHAPES = ("sphere", "cube", "cylinder", "cone")  # order of the rows of a confusion matrix


def figure3(confusion: Sequence[Sequence[int]] | None, columns: Sequence[Column]) -> Picture:
    """Figure 3: (a) the confusion matrix of the split by image, if there are counts, and (b) success by target."""
    from experiments.report import PALETTE, Picture  # loads matplotlib

    colours = [*_GREYS, *(PALETTE[index % len(PALETTE)] for index in range(len(columns)))]
    names = [*(f"paper: {name}" for name in PAPER), *(column.decider for column in columns)]
    success = partial(_success, columns=columns, styles=dict(zip(names, colours, strict=True)))
    caption = f"Success by target in the scene {columns[0].scene}, with 95 % Wilson intervals; the paper's is hatched."
    legend, size = dict(zip(names, colours, strict=True)), (3.2, 3.9)
    if confusion is None:
        return Picture("figure3", caption, [success], legend, size, 4, widths=(1.5,))
    caption = f"(a) Confusions of the classifier split by image; in brackets, the paper's recalls. (b) {caption}"
    panels = [partial(_confusion, confusion=confusion), success]
    return Picture("figure3", caption, panels, legend, size, 4, widths=(1.0, 1.5))


def _confusion(axes: Axes, confusion: Sequence[Sequence[int]]) -> None:
    """Draw the confusion matrix with our fractions and, on the diagonal, the paper's recalls."""
    labels = list(table1.PAPER)
    order = [_SHAPES.index(label) for label in labels]
    counts = np.array(confusion)[np.ix_(order, order)]
    fractions = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    texts = [[f"{fraction:.2f}" for fraction in row] for row in fractions]
    for row, printed in enumerate(table1.PAPER.values()):
        texts[row][row] += f"\n(paper {printed.recall:.2f})"
    axes.imshow(fractions, cmap="Blues", vmin=0, vmax=1)
    for (row, column), fraction in np.ndenumerate(fractions):
        colour = "white" if fraction > 0.5 else "black"
        axes.text(column, row, texts[row][column], ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(labels)), labels, rotation=30, ha="right")
    axes.set_yticks(range(len(labels)), labels)
    axes.set(xlabel="predicted", ylabel="true", title="(a) classifier, split by image")


def _success(axes: Axes, columns: Sequence[Column], styles: Mapping[str, str]) -> None:
    """Draw bars by target: the paper's (hatched), and ours with 95 % Wilson intervals; ``styles`` are colours."""
    from experiments.report import INK  # loads matplotlib

    targets = list(PAPER["PPO"])
    width, x = 0.85 / len(styles), np.arange(len(targets))
    places = [x - 0.425 + (index + 0.5) * width for index in range(len(styles))]
    for (name, printed), place in zip(PAPER.items(), places, strict=False):
        label = f"paper: {name}"
        style: Any = {"color": styles[label], "edgecolor": "0.4", "hatch": "//", "label": label}
        axes.bar(place, [printed[target] for target in targets], 0.9 * width, **style)
    for column, place in zip(columns, places[len(PAPER) :], strict=True):
        wins = np.array([column.successes[target] for target in targets])
        low, high = np.transpose([wilson_interval(int(n), column.trials) for n in wins])
        share = wins / column.trials
        axes.bar(place, share, 0.9 * width, color=styles[column.decider], label=column.decider)
        spread = [np.maximum(share - low, 0.0), np.maximum(high - share, 0.0)]
        axes.errorbar(place, share, spread, fmt="none", ecolor=INK, elinewidth=0.7)
    axes.set_xticks(x, targets)
    axes.set_ylim(0, 1.03)
    axes.set(title=f"(b) searches, scene {columns[0].scene}", ylabel="success")
