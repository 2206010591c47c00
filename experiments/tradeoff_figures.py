"""The figure of the trade: success against time of a search, the fronts drawn through."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter

from activetouch.atomic import atomic_path
from experiments.figures import INK, PALETTE, STYLE, svg
from experiments.tradeoff_picks import Front

_SCENES = {"paper": PALETTE[3], "coarse": PALETTE[1], "gel": PALETTE[0], "hard": PALETTE[2], "many": PALETTE[4]}
_LEAST_ERROR = 3e-4  # of the axis; no error at all is drawn there


def front_figure(fronts: Sequence[Front]) -> Figure:
    """Share of failed searches against milliseconds of a search, both logarithmic, one panel a task."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.2 * len(fronts), 4.0), layout="constrained")
        for axes, front in zip(figure.subplots(1, len(fronts), squeeze=False)[0], fronts, strict=True):
            for scene, colour in _SCENES.items():
                for kind, marker in (("recorded", "o"), ("live", "D")):
                    chosen = [
                        (point, prob)
                        for point, prob in zip(front.points, front.probs, strict=True)
                        if (point.configuration.scene, point.configuration.touches) == (scene, kind)
                    ]
                    if not chosen:
                        continue
                    x = [point.ms_per_search for point, _ in chosen]
                    y = np.maximum([1 - point.success for point, _ in chosen], _LEAST_ERROR)
                    ends = np.array([point.interval for point, _ in chosen])
                    low, high = np.maximum(1 - ends[:, 1], _LEAST_ERROR), np.maximum(1 - ends[:, 0], y)
                    spread = [np.maximum(y - low, 0.0), high - y]
                    axes.errorbar(x, y, spread, fmt="none", ecolor=colour, elinewidth=0.6, alpha=0.35)
                    sizes = [14 + 50 * prob for _, prob in chosen]
                    filled = colour if kind == "recorded" else "none"
                    axes.scatter(
                        x, y, sizes, filled, marker=marker, edgecolors=colour, label=f"{scene}, {kind}", zorder=3
                    )
            best = [point for point, on in zip(front.points, front.on_front, strict=True) if on]
            axes.step(
                [point.ms_per_search for point in best],
                [max(1 - point.success, _LEAST_ERROR) for point in best],
                where="post",
                color=INK,
                linewidth=1,
                linestyle="--",
            )
            axes.set(xscale="log", yscale="log", xlabel="ms of a search, on one core", title=front.task)
            axes.set_ylim(_LEAST_ERROR * 0.7, 1.0)
            axes.yaxis.set_major_locator(FixedLocator([_LEAST_ERROR, 0.001, 0.01, 0.1, 1.0]))
            axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y == _LEAST_ERROR else f"{y:g}"))
            axes.yaxis.minorticks_off()
            axes.legend(frameon=False, fontsize=8)
        figure.axes[0].set_ylabel("share of searches that fail")
        return figure


def write_figure(figure: Figure, path: Path) -> None:
    """Write it as SVG."""
    with matplotlib.rc_context(STYLE), atomic_path(path) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None})


def inline(figure: Figure) -> str:
    """The figure for a page."""
    with matplotlib.rc_context(STYLE):
        return svg(figure)
