"""The figure of the trade: success against time of a search, the fronts drawn through."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from belief.files import atomic_path
from experiments.search.figures import INK, PALETTE, STYLE, svg
from experiments.tradeoff.picks import Front

_SCENES = {"paper": PALETTE[3], "coarse": PALETTE[1], "gel": PALETTE[0], "hard": PALETTE[2], "many": PALETTE[4]}
_MARKERS = {
    "nothing": "*",
    "decider": "o",
    "touch cost λ": "v",
    "network": "s",
    "precision": "P",
    "observation model": "^",
    "fidelity": "D",
}
_LABELS = {"nothing": "the scene's default", "decider": "another decider", "network": "network or resolution"}
_LEAST_ERROR = 3e-4  # of the axis; no error at all is drawn there


def front_figure(fronts: Sequence[Front]) -> Figure:
    """Share of failed searches against milliseconds of a search, both logarithmic, one panel a task."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(1.0 + 3.6 * len(fronts), 4.6), layout="constrained")
        for axes, front in zip(figure.subplots(1, len(fronts), squeeze=False, sharey=True)[0], fronts, strict=True):
            for point, prob in zip(front.points, front.probs, strict=True):
                colour, marker = _SCENES[point.configuration.scene], _MARKERS[point.configuration.varied]
                x, (low, high) = point.ms_per_search, point.interval
                axes.plot([x, x], [_error(high), _error(low)], color=colour, linewidth=0.6, alpha=0.35)
                size = 22 + 60 * prob
                axes.scatter(x, _error(point.success), size, colour, marker=marker, alpha=0.85, linewidths=0, zorder=3)
            best = [point for point, on in zip(front.points, front.on_front, strict=True) if on]
            axes.step(
                [point.ms_per_search for point in best],
                [_error(point.success) for point in best],
                where="post",
                color=INK,
                linewidth=1,
                linestyle="--",
            )
            axes.set(xscale="log", yscale="log", xlabel="ms of a search, on one core", title=_wrapped(front.task))
            axes.set_ylim(_LEAST_ERROR * 0.7, 1.0)
            axes.yaxis.set_major_locator(FixedLocator([_LEAST_ERROR, 0.001, 0.01, 0.1, 1.0]))
            axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y == _LEAST_ERROR else f"{y:g}"))
            axes.yaxis.minorticks_off()
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())
            shown = {point.configuration.scene for point in front.points}
            handles = [_handle("o", colour, scene) for scene, colour in _SCENES.items() if scene in shown]
            axes.legend(handles=handles, frameon=False, fontsize=8)
        figure.axes[0].set_ylabel("share of searches that fail")
        varied = [_handle(marker, "0.5", _LABELS.get(what, what)) for what, marker in _MARKERS.items()]
        columns = 4 if len(fronts) > 1 else 2
        figure.legend(handles=varied, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)
        return figure


def _handle(marker: str, colour: str, label: str) -> Line2D:
    return Line2D([], [], marker=marker, linestyle="", color=colour, label=label)


def _error(success: float) -> float:
    return max(1 - success, _LEAST_ERROR)


def _wrapped(title: str) -> str:
    return "\n".join(textwrap.wrap(title, 30))


def write_figure(figure: Figure, path: Path) -> None:
    """Write it as SVG."""
    with matplotlib.rc_context(STYLE), atomic_path(path) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None})


def inline(figure: Figure, name: str) -> str:
    """The figure for a page, on which no other has this name."""
    with matplotlib.rc_context(STYLE):
        return svg(figure, name)
