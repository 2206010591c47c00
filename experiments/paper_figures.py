"""The paper's Figures 2 and 3, made here: a touch image of every shape; confusion matrix and success by shape."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from activetouch.dataset import TouchSet
from experiments import table1
from experiments.figures import PALETTE, STYLE
from experiments.table2 import PAPER, Column
from experiments.tradeoff_figures import write_figure

_IMAGES = 5  # of each shape


def draw_figure2(images: TouchSet, labels: Sequence[str], path: Path) -> None:
    """Images of every shape, each of another press: the paper's Figure 2 shows one of each."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(1.5 * _IMAGES, 1.6 * len(labels)), layout="constrained")
        grid = figure.subplots(len(labels), _IMAGES, squeeze=False)
        for shape, label in enumerate(labels):
            rows = np.flatnonzero(images.shapes == shape)
            chosen = rows[np.linspace(0, len(rows) - 1, _IMAGES).round().astype(int)]
            for axes, row in zip(grid[shape], chosen, strict=True):
                axes.imshow(images.images[row], origin="lower")
                axes.set(xticks=[], yticks=[])
            grid[shape][0].set_ylabel(label)
        write_figure(figure, path)


def draw_figure3(confusion: Sequence[Sequence[int]] | None, columns: Sequence[Column], path: Path) -> None:
    """(a) The confusion matrix of the classifier that was split by image, as the paper's; (b) success by shape.

    Args:
        confusion: counts of (true shape, predicted shape); (a) is left out without.
        columns: of Table 2.
        path: to write.
    """
    with matplotlib.rc_context(STYLE):
        panels = 1 + (confusion is not None)
        figure = Figure(figsize=(3.2 + 5.4 * (panels - 1) + 3.0, 3.8), layout="constrained")
        drawn = list(figure.subplots(1, panels, squeeze=False, width_ratios=[1.0, 1.5][-panels:])[0])
        if confusion is not None:
            _confusion(drawn[0], confusion)
        _success(drawn[-1], [column for column in columns if not column.missing])
        write_figure(figure, path)


def _confusion(axes, confusion: Sequence[Sequence[int]]) -> None:
    labels = list(table1.PAPER)
    matrix = np.array(confusion, float)
    order = [_SHAPES.index(label) for label in labels]
    shares = (matrix / matrix.sum(axis=1, keepdims=True))[np.ix_(order, order)]
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1)
    for (row, column), share in np.ndenumerate(shares):
        text = f"{share:.2f}" + (f"\n(paper {table1.PAPER[labels[row]].recall:.2f})" if row == column else "")
        axes.text(column, row, text, ha="center", va="center", fontsize=8, color="white" if share > 0.6 else "black")
    axes.set_xticks(range(len(labels)), labels, rotation=35, ha="right")
    axes.set_yticks(range(len(labels)), labels)
    axes.set(xlabel="predicted", ylabel="true", title="(a) classifier, split by image")


_SHAPES = ("sphere", "cube", "cylinder", "cone")


def _success(axes, columns: Sequence[Column]) -> None:
    targets = list(PAPER["PPO"])
    bars = {f"paper: {name}": [PAPER[name][target] for target in targets] for name in PAPER}
    bars |= {column.name: [column.successes[target] / column.trials for target in targets] for column in columns}
    width = 0.85 / len(bars)
    for index, (name, values) in enumerate(bars.items()):
        x = np.arange(len(targets)) + (index - (len(bars) - 1) / 2) * width
        hatch = "//" if name.startswith("paper") else None
        axes.bar(x, values, width * 0.92, color=PALETTE[index % len(PALETTE)], label=name, hatch=hatch)
    axes.set_xticks(range(len(targets)), targets)
    axes.set(ylabel="success", ylim=(0, 1.03), title="(b) searches")
    axes.legend(frameon=False, fontsize=7, ncols=2, loc="upper left", bbox_to_anchor=(0, -0.08))
