"""Errors of classifiers with their intervals, which the frontier and the learning curve draw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from experiments.sensor.scores import Scores


def draw_errors(
    axes: Axes, x: NDArray[Any], scores: Sequence[Scores], colour: str, label: str = ""
) -> NDArray[np.float64]:
    """Draw errors as dots with intervals on logarithmic axes.

    Args:
        axes: to draw on.
        x: positions, ``(N,)``.
        scores: N of them.
        colour: of dots and intervals.
        label: in the legend.

    Returns:
        The errors, ``(N,)``.
    """
    error = np.array([1.0 - score.accuracy for score in scores])
    low, high = (np.array([1.0 - score.interval[side] for score in scores]) for side in (1, 0))
    reach = [error - low, high - error]
    axes.errorbar(x, error, reach, fmt="o", color=colour, elinewidth=1, capsize=2, alpha=0.8, label=label)
    axes.set(xscale="log", yscale="log", ylabel="single touches misread")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:g} %"))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25, which="both")
    return error
