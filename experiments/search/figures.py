"""Figures of a comparison."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis

from experiments.reporting.style import Picture
from experiments.search.summary import ALL, Cell, Summary

_WIDTH = 5.2  # inches; narrow, so that text stays readable on a phone
_MARKERS = "osD^vP*X"


def pictures(comparison: Summary) -> list[Picture]:
    """All figures of a comparison."""
    num_deciders, num_groups = len(comparison.deciders), len(comparison.targets) + 1
    return [
        Picture(name, caption, [partial(FIGURES[name], comparison)], size=(_WIDTH, height))
        for name, caption, height in (
            ("success", _SUCCESS, 1.0 + num_groups * (0.16 * num_deciders + 0.16)),
            ("frontier", _FRONTIER, 3.4),
        )
    ]


_SUCCESS = (
    "Fraction of failed searches by target, with 95 % Wilson intervals, on a logarithmic axis: points further left are "
    "better. An open marker at the left edge stands for no failure at all. The dotted line is the no-touch baseline."
)
_FRONTIER = (
    "Fraction of failed searches against touches per search, over all targets. Points further down and to the left are "
    "better. An open marker at the lower edge stands for no failure at all. The dotted line is the no-touch baseline."
)


def draw_success(comparison: Summary, axes: Axes) -> None:
    """Draw the fraction of failed searches by target."""
    groups, least, count = [*comparison.targets, ALL], _least_failure(comparison), len(comparison.deciders)
    axes.axvline(1.0 - comparison.no_touch_baseline, color=rcParams["text.color"], linestyle=":", linewidth=1)
    for index, decider in enumerate(comparison.deciders):
        for place, group in enumerate(groups):
            y = place + 0.7 * ((index + 0.5) / count - 0.5)
            value, bars, style = _failures(comparison.cells[decider, group], least, index)
            axes.errorbar(value, y, xerr=bars, **style, label=decider if place == 0 else None)
    axes.set(xscale="log", xlabel="failed searches", xlim=(least / 1.4, 1.4))
    axes.set(yticks=np.arange(len(groups)), yticklabels=groups)
    _plain_numbers(axes.xaxis)
    axes.invert_yaxis()
    _legend(axes, comparison)


def draw_frontier(comparison: Summary, axes: Axes) -> None:
    """Draw the fraction of failed searches against touches per search."""
    least, count = _least_failure(comparison), len(comparison.deciders)
    axes.axhline(1.0 - comparison.no_touch_baseline, color=rcParams["text.color"], linestyle=":", linewidth=1)
    for index, decider in enumerate(comparison.deciders):
        value, bars, style = _failures(comparison.cells[decider, ALL], least, index)
        style["markersize"] = 5 + 5.4 * (count - 1 - index) / max(count - 1, 1)  # the first is largest: none hides
        axes.errorbar(comparison.cells[decider, ALL].touches, value, yerr=bars, **style, label=decider)
    axes.set(yscale="log", xlabel="touches per search", ylabel="failed searches", ylim=(least / 1.4, 1.4))
    _plain_numbers(axes.yaxis)
    axes.set_xlim(left=-0.04 * axes.get_xlim()[1])
    _legend(axes, comparison)


FIGURES: Mapping[str, Callable[[Summary, Axes], None]] = MappingProxyType(
    {"success": draw_success, "frontier": draw_frontier}
)
"""Functions that draw a figure of a comparison on an axis, by name."""


def _least_failure(comparison: Summary) -> float:
    """Where a fraction of zero is drawn on a logarithmic axis: half a failure in the largest group."""
    return 0.5 / max(cell.num_episodes for cell in comparison.cells.values())


def _failures(cell: Cell, least: float, index: int) -> tuple[float, list[list[float]], dict[str, Any]]:
    """Fraction of failures, lengths of its error bar, and its style; no failures at all have an open marker."""
    low, high = (1.0 - end for end in reversed(cell.success_interval))
    value, marker = 1.0 - cell.success, _MARKERS[index % len(_MARKERS)]  # for readers who cannot tell colours apart
    style = {"color": f"C{index}", "marker": marker, "linestyle": "none", "markersize": 5, "linewidth": 1.3}
    if cell.successes == cell.num_episodes:
        return least, [[0.0], [max(high - least, 0.0)]], style | {"markerfacecolor": "none"}
    return value, [[value - max(low, least)], [max(high - value, 0.0)]], style


def _plain_numbers(axis: Axis) -> None:
    """Label a logarithmic axis with 0.01, not with powers, which take a tenth of a report's time to typeset."""
    axis.set_major_formatter("{x:g}")
    low, high = axis.get_view_interval()
    between = "235" if high < 10 * low else ""  # also 0.2, 0.3 and 0.5 where less than a decade is shown
    axis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in between else "")


def _legend(axes: Axes, comparison: Summary) -> None:
    widest = 0.55 + 0.075 * max(map(len, comparison.deciders))  # inches
    width = axes.get_window_extent().width / axes.figure.dpi / 0.78  # with the labels beside the axis, about
    columns = min(max(int(width / widest), 1), len(comparison.deciders))
    axes.legend(frameon=False, ncols=columns, loc="lower center", bbox_to_anchor=(0.5, 1))
