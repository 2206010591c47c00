"""Figure of the trade-off: failed searches against time per search, one panel per scene."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from belief.statistics import pareto_front
from experiments.reporting.style import INK, PALETTE, Picture
from experiments.tradeoff.configuration import SHARES
from experiments.tradeoff.measure import Front, Measured

_DEFAULT = "nothing"
_STYLES = {  # colour, marker, and name in the legend, by what differs from the default
    "hypotheses": (PALETTE[0], "P", "number of hypotheses, 64 to 16 384"),
    "touch cost λ": (PALETTE[1], "v", "touch cost λ, 0.1 to 0.005"),
    "sensor": (PALETTE[2], "X", "another shipped sensor"),
    "decider": (PALETTE[3], "o", "decider"),
    "network": (PALETTE[4], "s", "network or resolution"),
    "fidelity": ("#777777", "D", "fidelity of the press"),
    _DEFAULT: (INK, "*", "the scene's default"),
}
_LEAST_ERROR = 3e-4  # lower end of the axis, where an error of zero is drawn
_CAPTION = (
    "Failed searches against time, one panel per scene. Each point is a configuration that differs from the scene's "
    "default in one property, with its 95 % Wilson interval. Lines join the settings of a number. Dashed: no "
    "configuration of the scene is both faster and more successful."
)


def front_picture(fronts: Sequence[Front]) -> Picture:
    """Fraction of failed searches against milliseconds per search, both logarithmic, one panel per scene."""
    points = [point for front in fronts for point in front.points]
    scenes = [scene for scene in SHARES if any(point.configuration.scene == scene for point in points)]
    panels = [
        partial(_draw, scene=scene, points=[point for point in points if point.configuration.scene == scene])
        for scene in scenes
    ]
    legend = {label: colour for colour, _, label in _STYLES.values()}
    return Picture("tradeoff", _CAPTION, panels, legend, size=(3.6, 3.0), columns=3)


def _draw(axes: Axes, scene: str, points: Sequence[Measured]) -> None:
    for what, (colour, marker, _) in _STYLES.items():
        of_kind = [point for point in points if point.configuration.varied == what]
        for point in of_kind:
            low, high = point.interval
            axes.plot([point.ms_per_search] * 2, [_error(high), _error(low)], color=colour, linewidth=0.6, alpha=0.35)
        size = 150 if what == _DEFAULT else 30
        times, errors = [point.ms_per_search for point in of_kind], [_error(point.success) for point in of_kind]
        axes.scatter(times, errors, size, colour, marker=marker, alpha=0.85, linewidths=0, zorder=3)
        for line in _dials(of_kind):
            path = [(point.ms_per_search, _error(point.success)) for point in line]
            axes.plot(*np.transpose(path), color=colour, linewidth=1.2, alpha=0.7)
    best = _front(points)
    axes.step(*np.transpose(best), where="post", color=INK, linewidth=1, linestyle="--")
    axes.set(xscale="log", yscale="log", xlabel="ms per search, on one core", ylabel="failed searches", title=scene)
    axes.set_ylim(_LEAST_ERROR * 0.7, 1.0)
    axes.yaxis.set_major_locator(FixedLocator([_LEAST_ERROR, 0.001, 0.01, 0.1, 1.0]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y == _LEAST_ERROR else f"{y:g}"))
    axes.yaxis.minorticks_off()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _dials(points: Sequence[Measured]) -> list[list[Measured]]:
    """Configurations that differ in one number, in the order of this number: one list for each decider."""
    numbered = sorted(
        (p for p in points if p.configuration.number is not None), key=lambda p: p.configuration.number or 0.0
    )
    deciders = dict.fromkeys(p.configuration.decider for p in numbered)
    return [[p for p in numbered if p.configuration.decider == name] for name in deciders]


def _front(points: Sequence[Measured]) -> list[tuple[float, float]]:
    """Time and error of the configurations than which none is both faster and at least as successful."""
    times, successes = np.array([p.ms_per_search for p in points]), np.array([p.success for p in points])
    return sorted(
        (points[i].ms_per_search, _error(points[i].success))
        for i in np.flatnonzero(pareto_front(times, successes)).tolist()
    )


def _error(success: float) -> float:
    return max(1 - success, _LEAST_ERROR)
