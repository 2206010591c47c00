"""Figure of the trade-off: success against time per search, with the Pareto fronts."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from functools import partial

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from experiments.reporting.style import INK, PALETTE, Picture
from experiments.tradeoff.picks import Front

_SCENES = {"paper": PALETTE[3], "coarse": PALETTE[1], "gel": PALETTE[0], "hard": PALETTE[2], "many": PALETTE[4]}
_MARKERS = {
    "nothing": "*",
    "decider": "o",
    "touch cost λ": "v",
    "sensor": "X",
    "network": "s",
    "hypotheses": "P",
    "observation model": "^",
    "fidelity": "D",
}
_LABELS = {
    "nothing": "the scene's default",
    "decider": "another decider",
    "network": "network or resolution",
    "sensor": "another shipped sensor",
    "hypotheses": "number of hypotheses",
}
_LEAST_ERROR = 3e-4  # lower end of the axis, where an error of zero is drawn
_CAPTION = (
    "Failed searches against time. Each point is a configuration with its 95 % Wilson interval. Colours are scenes; "
    "markers say what differs from the scene's default. The larger a point, the more probable it is on the front "
    "(dashed line)."
)


def front_picture(fronts: Sequence[Front]) -> Picture:
    """Fraction of failed searches against milliseconds per search, both logarithmic, one panel per task."""
    return Picture("tradeoff", _CAPTION, [partial(_draw, front=front) for front in fronts], size=(4.6, 5.2))


def _draw(axes: Axes, front: Front) -> None:
    for point, prob in zip(front.points, front.probs, strict=True):
        colour, marker = _SCENES[point.configuration.scene], _MARKERS[point.configuration.varied]
        x, (low, high) = point.ms_per_search, point.interval
        axes.plot([x, x], [_error(high), _error(low)], color=colour, linewidth=0.6, alpha=0.35)
        size = 22 + 60 * prob
        axes.scatter(x, _error(point.success), size, colour, marker=marker, alpha=0.85, linewidths=0, zorder=3)
    best = [point for point, on in zip(front.points, front.on_front, strict=True) if on]
    times, errors = [point.ms_per_search for point in best], [_error(point.success) for point in best]
    axes.step(times, errors, where="post", color=INK, linewidth=1, linestyle="--")
    title = "\n".join(textwrap.wrap(front.task, 30))
    axes.set(xscale="log", yscale="log", xlabel="ms per search, on one core", ylabel="failed searches", title=title)
    axes.set_ylim(_LEAST_ERROR * 0.7, 1.0)
    axes.yaxis.set_major_locator(FixedLocator([_LEAST_ERROR, 0.001, 0.01, 0.1, 1.0]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y == _LEAST_ERROR else f"{y:g}"))
    axes.yaxis.minorticks_off()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    shown = {point.configuration.scene for point in front.points}
    scenes = [_handle("o", colour, scene) for scene, colour in _SCENES.items() if scene in shown]
    varied = [_handle(marker, "0.5", _LABELS.get(what, what)) for what, marker in _MARKERS.items()]
    axes.legend(
        handles=[*scenes, *varied], frameon=False, fontsize=8, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.14)
    )


def _handle(marker: str, colour: str, label: str) -> Line2D:
    return Line2D([], [], marker=marker, linestyle="", color=colour, label=label)


def _error(success: float) -> float:
    return max(1 - success, _LEAST_ERROR)
