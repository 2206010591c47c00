"""Figures of a comparison, as inline SVG for the report and as files."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from belief import SearchProblem
from experiments.replay import Frame, action_words
from experiments.summary import Comparison
from planners import Episode

# Colour-blind safe (Okabe and Ito 2008).
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
INK = "#010203"
"""Stands for the page's text colour; replaced by currentColor in inline SVG."""
STYLE = {
    "font.size": 10.0,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "activetouch",
} | dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK)


def success_figure(comparison: Comparison) -> str:
    """Success by target and decider, with Wilson intervals and the floor, as SVG."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.5, 3.6), layout="constrained")
        axes = figure.subplots()
        _grouped(axes, comparison, lambda cell: (cell.success, cell.success_interval))
        ceiling = comparison.ceiling[0] / comparison.ceiling[1]
        for level, name in ((comparison.floor, "floor"), (ceiling, "ceiling")):
            axes.axhline(level, color=INK, linestyle=":", linewidth=1)
            axes.annotate(f"{name} {level:.2f}", (1.005, level), xycoords=("axes fraction", "data"), va="center")
        axes.set(ylabel="success", ylim=(0, 1.03))
        return svg(figure)


def touches_figure(comparison: Comparison) -> str:
    """Mean touches per search by target and decider, as SVG; the floor needs none."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.5, 3.0), layout="constrained")
        axes = figure.subplots()
        _grouped(axes, comparison, lambda cell: (cell.touches, None))
        axes.set(ylabel="touches per search", xlabel=f"target (floor: success {comparison.floor:.2f} without a touch)")
        return svg(figure)


def time_figure(comparison: Comparison) -> str:
    """Milliseconds per touch, split into physics, network and decision, as SVG."""
    with matplotlib.rc_context(STYLE):
        names = [name for name in comparison.deciders if comparison.cells[name, "all"].seconds.num_touches]
        figure = Figure(figsize=(7.5, 0.8 + 0.45 * len(names)), layout="constrained")
        axes = figure.subplots()
        left = np.zeros(len(names))
        for part, colour in zip(("physics", "network", "decision"), PALETTE, strict=False):
            width = np.array([comparison.cells[name, "all"].seconds.ms_per_touch()[part] for name in names])
            axes.barh(names, width, left=left, color=colour, label=part, height=0.6)
            left += width
        axes.set(xlabel=f"ms per touch (floor: success {comparison.floor:.2f} without a touch)")
        axes.invert_yaxis()
        axes.legend(frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1, 1))
        return svg(figure)


def draw_search(episode: Episode, frames: list[Frame], problem: SearchProblem, path: Path) -> None:
    """Write a picture of one search: every touch image, and the belief it left."""
    touched = [number for number, frame in enumerate(frames) if frame.image is not None]
    labels = problem.shape_labels
    with matplotlib.rc_context({"font.size": 9.0, "font.family": "sans-serif"}):
        figure = Figure(figsize=(1.75 * max(len(touched), 3) + 0.9, 4.2), layout="constrained")
        grid = figure.subplots(2, max(len(touched), 1), squeeze=False, height_ratios=(1.25, 1))
        for column, number in enumerate(touched):
            frame, following = frames[number], frames[number + 1]  # a touch is always followed by a decision
            pose = problem.pose_labels[frame.step.touch.pose]
            top, bottom = grid[0, column], grid[1, column]
            top.imshow(frame.image, cmap="magma", vmin=0, vmax=255, origin="lower")
            top.set(xticks=[], yticks=[])
            top.set_title(f"object {frame.step.object_index + 1} (a {labels[frame.shape]})\npose {pose}")
            colours = [PALETTE[1] if k == episode.target else "#9aa5b1" for k in range(len(labels))]
            bottom.barh(labels, frame.posterior, color=colours)
            bottom.set(xlim=(0, 1), xticks=(0, 0.5, 1))
            bottom.invert_yaxis()
            bottom.spines[["top", "right"]].set_visible(False)
            if column:
                bottom.set_yticks([])
            bottom.set_xlabel(f"→ {action_words(following.step.decision.action, problem)}", fontweight="bold")
        verdict = "found" if episode.success else "failed"
        figure.suptitle(f"Searching for a {labels[episode.target]}: {verdict} after {episode.num_touches} touches")
        figure.savefig(path, dpi=130)


def _grouped(axes, comparison: Comparison, value) -> None:
    groups = [*comparison.targets, "all"]
    width = 0.8 / len(comparison.deciders)
    for index, decider in enumerate(comparison.deciders):
        x = np.arange(len(groups)) + (index - (len(comparison.deciders) - 1) / 2) * width
        values, intervals = zip(*(value(comparison.cells[decider, group]) for group in groups), strict=True)
        axes.bar(x, values, width * 0.92, color=PALETTE[index % len(PALETTE)], label=decider)
        if intervals[0] is not None:
            low, high = np.array(intervals).T
            axes.errorbar(x, values, [values - low, high - values], fmt="none", ecolor=INK, elinewidth=1, capsize=2)
    crowded = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"} if len(groups) > 6 else {}
    axes.set_xticks(np.arange(len(groups)), groups, **crowded)
    axes.legend(frameon=False, ncols=len(comparison.deciders), loc="lower center", bbox_to_anchor=(0.5, 1))


def svg(figure: Figure) -> str:
    """A figure as inline SVG, its text in the colour of the page's."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :].replace(INK, "currentColor")
