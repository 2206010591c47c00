"""The paper's Figure 3: confusion matrix and success by target."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from belief.statistics import wilson_interval
from experiments.paper import table1
from experiments.paper.table2 import PAPER, Column
from experiments.reporting.style import INK, PALETTE, figure

_SHAPES = ("sphere", "cube", "cylinder", "cone")  # order of the rows of a confusion matrix


def draw_figure3(confusion: Sequence[Sequence[int]] | None, columns: Sequence[Column], path: Path) -> None:
    """Draw (a) the confusion matrix of the classifier that was split by image, and (b) success by target.

    Without counts of (true shape, predicted shape), (a) is left out.
    """
    widths = [1.0, 1.5] if confusion is not None else [1.5]
    with figure((3.2 * sum(widths), 4.2), path) as drawn:
        panels = list(drawn.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0])
        if confusion is not None:
            _confusion(panels[0], confusion)
        _success(panels[-1], columns)
        panels[-1].set(title=f"(b) searches, scene {columns[0].scene}", ylabel="success")
        drawn.legend(loc="outside lower right", ncols=4, frameon=False, fontsize=8)


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


def _success(axes: Axes, columns: Sequence[Column]) -> None:
    """Draw bars by target: the paper's (hatched), and ours with 95 % Wilson intervals."""
    targets = list(PAPER["PPO"])
    width, x = 0.85 / (len(PAPER) + len(columns)), np.arange(len(targets))
    first = -0.425 + width / 2
    for index, (name, printed) in enumerate(PAPER.items()):
        heights = [printed[target] for target in targets]
        place = x + first + index * width
        grey = str(0.6 + 0.3 * index)
        axes.bar(place, heights, 0.9 * width, color=grey, edgecolor="0.4", hatch="//", label=f"paper: {name}")
    for index, column in enumerate(columns):
        wins = np.array([column.successes[target] for target in targets])
        low, high = np.transpose([wilson_interval(int(n), column.trials) for n in wins])
        share, place = wins / column.trials, x + first + (len(PAPER) + index) * width
        axes.bar(place, share, 0.9 * width, color=PALETTE[index % len(PALETTE)], label=column.decider)
        spread = [np.maximum(share - low, 0.0), np.maximum(high - share, 0.0)]
        axes.errorbar(place, share, spread, fmt="none", ecolor=INK, elinewidth=0.7)
    axes.set_xticks(x, targets)
    axes.set_ylim(0, 1.03)
