"""Figures about classifiers: confusion matrices, the frontier of cost and error, learning curves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from belief.files import atomic_path
from experiments.search.figures import PALETTE

if TYPE_CHECKING:
    from experiments.paper.table1 import Result
    from experiments.sensor.frontier import Entry
    from experiments.sensor.learning_curve import Point
    from experiments.sensor.scores import Scores


def draw_confusions(results: dict[str, dict[str, Result]], labels: tuple[str, ...], path: Path) -> None:
    """One matrix for every split (row) and set of images read (column), as SVG (paper Figure 3a)."""
    rows, columns = list(results), list(next(iter(results.values())))
    with _figure((3.6 * len(columns), 3.5 * len(rows)), path) as figure:
        grid = figure.subplots(len(rows), len(columns), squeeze=False)
        for name, line in zip(rows, grid, strict=True):
            for what, axes in zip(columns, line, strict=True):
                result = results[name][what]
                counts = np.array(result.confusion)
                axes.imshow(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1), cmap="Blues", vmin=0, vmax=1)
                for (true, read), count in np.ndenumerate(counts):
                    dark = count > 0.5 * counts[true].sum()
                    axes.text(read, true, str(count), ha="center", va="center", color="white" if dark else "black")
                axes.set(title=f"split {name}, {what}: {result.accuracy:.3f}", xlabel="read as")
                axes.set_xticks(range(len(labels)), labels, rotation=30, ha="right")
                axes.set_yticks(range(len(labels)), labels)
            line[0].set_ylabel("true shape")


def draw_frontier(entries: Sequence[Entry], scene: str, path: Path) -> None:
    """Error with its interval against the time of a single touch, as SVG; a colour for each precision."""
    with _figure((7.0, 4.2), path) as figure:
        batch = min(entries[0].milliseconds)
        axes = figure.subplots()
        for precision, colour in zip(dict.fromkeys(entry.precision for entry in entries), PALETTE, strict=False):
            some = [entry for entry in entries if entry.precision == precision]
            time = np.array([entry.milliseconds[batch] for entry in some])
            _errors(axes, time, [entry.scores for entry in some], colour, precision)
        for network in dict.fromkeys(entry.network for entry in entries):
            some = [entry for entry in entries if entry.network == network]
            left = min(entry.milliseconds[batch] for entry in some)
            top = max(1.0 - entry.scores.interval[0] for entry in some)
            axes.annotate(network, (left, top), xytext=(0, 5), textcoords="offset points")
        axes.set(xlabel=f"milliseconds a touch, {batch} at once", title=f"scene {scene}")
        axes.legend(frameon=False)
        axes.margins(x=0.15, y=0.12)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


def draw_learning_curve(points: Sequence[Point], title: str, path: Path) -> None:
    """Error with its interval against images of each shape, as SVG."""
    with _figure((5.5, 3.6), path) as figure:
        images = np.array([point.images for point in points])
        axes = figure.subplots()
        error = _errors(axes, images, [point.scores for point in points], PALETTE[0])
        axes.plot(images, error, color=PALETTE[0], linewidth=1)
        axes.set(xlabel="images of each shape", title=title)
        axes.set_xticks(images, [f"{number}" for number in images])
        axes.xaxis.set_minor_formatter(NullFormatter())


def _errors(axes: Axes, x: NDArray, scores: Sequence[Scores], colour: str, label: str = "") -> NDArray[np.float64]:
    """Dots with intervals on logarithmic axes; returns the errors."""
    error = np.array([1.0 - score.accuracy for score in scores])
    low, high = (np.array([1.0 - score.interval[side] for score in scores]) for side in (1, 0))
    reach = [error - low, high - error]
    axes.errorbar(x, error, reach, fmt="o", color=colour, elinewidth=1, capsize=2, alpha=0.8, label=label)
    axes.set(xscale="log", yscale="log", ylabel="single touches misread")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:g} %"))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, which="both")
    return error


@contextmanager
def _figure(size: tuple[float, float], path: Path) -> Iterator[Figure]:
    """A figure that is written to ``path``, the same bytes for the same content."""
    with matplotlib.rc_context({"font.size": 9.0, "svg.fonttype": "none", "svg.hashsalt": "activetouch"}):
        figure = Figure(figsize=size, layout="constrained")
        yield figure
        with atomic_path(path) as temporary:
            figure.savefig(temporary, format="svg", metadata={"Date": None})
