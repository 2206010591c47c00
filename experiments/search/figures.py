"""Figures of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis

from experiments.reporting.style import INK, PALETTE, Picture
from experiments.search.selective import RANKINGS
from experiments.search.summary import ALL, Cell, Summary

_WIDTH = 5.2  # inches; narrow, so that text stays readable on a phone
_MARKERS = "osD^vP*X"
_SMALLEST_ERROR = 1e-4


def pictures(comparison: Summary) -> list[Picture]:
    """All figures of a comparison that have something to show."""
    found = _pictures(comparison)
    return [*found, _selective_risk(comparison)] if comparison.is_selective else found


def _pictures(comparison: Summary) -> list[Picture]:
    num_deciders, num_groups = len(comparison.deciders), len(comparison.targets) + 1
    wide, flat = 2.6 + 0.1 * num_deciders, 0.9 + 0.2 * num_deciders
    empty = {
        "stated_confidence": not any(comparison.calibration.values()),
        "times": not any(cell.seconds.num_touches for cell in comparison.cells.values()),
    }
    return [
        Picture(name, caption, [partial(panel, comparison=comparison)], size=(_WIDTH, height))
        for name, caption, height, panel in (
            ("success", _SUCCESS, 1.0 + num_groups * (0.16 * num_deciders + 0.16), _draw_success),
            ("frontier", _FRONTIER, 3.4, _draw_frontier),
            ("positions", _POSITIONS, wide, _draw_positions),
            ("touches", _TOUCHES, wide, _draw_touches),
            ("stated_confidence", _STATED, flat + 0.3, _draw_stated_confidence),
            ("times", _TIMES, flat + 0.2, _draw_times),
        )
        if not empty.get(name)
    ]


_SUCCESS = (
    "Fraction of failed searches by target, with 95 % Wilson intervals, on a logarithmic axis: points further left are "
    "better. An open marker at the left edge stands for no failure at all. The dotted line is the no-touch baseline."
)
_FRONTIER = (
    "Fraction of failed searches against touches per search, over all targets. Points further down and to the left are "
    "better. An open marker at the lower edge stands for no failure at all. The dotted line is the no-touch baseline."
)
_POSITIONS = "Success by position of the target in the order of visit, with 95 % Wilson intervals."
_TOUCHES = "Fraction of searches that took at most this number of touches."
_STATED = (
    "Error of confirmations: stated (open markers) and observed with 95 % Clopper-Pearson intervals (filled markers). "
    f"Errors below {_SMALLEST_ERROR:g} are drawn at {_SMALLEST_ERROR:g}."
)
_TIMES = "Time per touch by component."


def _draw_success(axes: Axes, comparison: Summary) -> None:
    groups, least = [*comparison.targets, ALL], _least_failure(comparison)
    axes.axvline(1.0 - comparison.no_touch_baseline, color=INK, linestyle=":", linewidth=1)
    for index, decider in enumerate(comparison.deciders):
        for place, group in enumerate(groups):
            y = place + _offset(index, len(comparison.deciders))
            value, bars, style = _failures(comparison.cells[decider, group], least, index)
            axes.errorbar(value, y, xerr=bars, **style, label=decider if place == 0 else None)
    axes.set(xscale="log", xlabel="failed searches", xlim=(least / 1.4, 1.4))
    axes.set(yticks=np.arange(len(groups)), yticklabels=groups)
    _plain_numbers(axes.xaxis)
    axes.invert_yaxis()
    _legend(axes, comparison)


def _draw_frontier(axes: Axes, comparison: Summary) -> None:
    least, count = _least_failure(comparison), len(comparison.deciders)
    axes.axhline(1.0 - comparison.no_touch_baseline, color=INK, linestyle=":", linewidth=1)
    for index, decider in enumerate(comparison.deciders):
        value, bars, style = _failures(comparison.cells[decider, ALL], least, index)
        style["markersize"] = 5 + 5.4 * _earlier(index, count)
        axes.errorbar(comparison.cells[decider, ALL].touches, value, yerr=bars, **style, label=decider)
    axes.set(yscale="log", xlabel="touches per search", ylabel="failed searches", ylim=(least / 1.4, 1.4))
    _plain_numbers(axes.yaxis)
    axes.set_xlim(left=-0.04 * axes.get_xlim()[1])
    _legend(axes, comparison)


def _least_failure(comparison: Summary) -> float:
    """Where a fraction of zero is drawn on a logarithmic axis: half a failure in the largest group."""
    return 0.5 / max(cell.num_episodes for cell in comparison.cells.values())


def _failures(cell: Cell, least: float, index: int) -> tuple[float, list[list[float]], dict[str, Any]]:
    """Fraction of failures, lengths of its error bar, and its style; no failures at all have an open marker."""
    low, high = (1.0 - end for end in reversed(cell.success_interval))
    value, style = 1.0 - cell.success, _style(index)
    if cell.successes == cell.num_episodes:
        return least, [[0.0], [max(high - least, 0.0)]], style | {"markerfacecolor": "none"}
    return value, [[value - max(low, least)], [max(high - value, 0.0)]], style


def _draw_positions(axes: Axes, comparison: Summary) -> None:
    labels = list(dict.fromkeys(place.label for places in comparison.positions.values() for place in places))
    labels.sort(key=lambda label: (label == "absent", label.zfill(4)))
    for index, (decider, places) in enumerate(comparison.positions.items()):
        x = [labels.index(p.label) + _offset(index, len(comparison.deciders)) / 2 for p in places]
        bars = np.array([p.interval for p in places]).T
        values = np.array([p.success for p in places])
        axes.errorbar(x, values, [values - bars[0], bars[1] - values], **_style(index), label=decider)
    axes.set(xlabel="position of the target", ylabel="success", ylim=(-0.02, 1.04))
    axes.set_xticks(range(len(labels)), labels)
    _legend(axes, comparison)


def _draw_touches(axes: Axes, comparison: Summary) -> None:
    for index, decider in enumerate(comparison.deciders):
        numbers = np.sort([episode.num_touches for episode in comparison.of(decider)])
        shares = np.arange(1, len(numbers) + 1) / len(numbers)
        width = 1.3 + 3.0 * _earlier(index, len(comparison.deciders))
        axes.step([0, *numbers], [0, *shares], where="post", color=_colour(index), label=decider, linewidth=width)
    axes.set(xlabel="touches", ylabel="fraction of searches", ylim=(0, 1.02))
    axes.set_xlim(left=-0.02 * axes.get_xlim()[1])
    _legend(axes, comparison)


def _draw_stated_confidence(axes: Axes, comparison: Summary) -> None:
    found = {name: stops for name, stops in comparison.calibration.items() if stops is not None}
    names = list(found)
    for y, name in enumerate(names):
        score, index = found[name].overall, comparison.deciders.index(name)
        observed = max(1.0 - score.share_right, _SMALLEST_ERROR)
        bounds = (max(1.0 - score.high, _SMALLEST_ERROR), max(1.0 - score.low, _SMALLEST_ERROR))
        _whiskers(axes, [observed], [y], [bounds], index, name)
        stated = max(1.0 - score.mean_stated, _SMALLEST_ERROR)
        axes.plot(stated, y, marker="D", markerfacecolor="none", markersize=8, color=_colour(index))
    axes.set(xscale="log", xlim=(_SMALLEST_ERROR / 1.3, 1.2), xlabel="error when confirming")
    _plain_numbers(axes.xaxis)
    axes.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.4, -0.6))


def _draw_times(axes: Axes, comparison: Summary) -> None:
    names = [name for name in comparison.deciders if comparison.cells[name, ALL].seconds.num_touches]
    left = np.zeros(len(names))
    for part, colour in zip(("physics", "network", "decision"), PALETTE, strict=False):
        width = np.array([comparison.cells[name, ALL].seconds.ms_per_touch()[part] for name in names])
        axes.barh(names, width, left=left, color=colour, label=part, height=0.6)
        left += width
    axes.set(xlabel="ms per touch", ylim=(len(names) - 0.4, -0.6))
    axes.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1))


def _selective_risk(comparison: Summary) -> Picture:
    names = [name for name, found in comparison.selective.items() if found is not None]
    return Picture(
        "selective_risk",
        "Selective risk against coverage: the fraction of wrong answers if only the most trusted answers are given, "
        "and the fraction of searches that these are. Left: answers ranked by their stated confidence; right: by the "
        "statistic of the conflict test, least conflict first. A curve ends where all answers are given; the rest of "
        "the searches ended with “I do not know” or at the touch limit. A ranking that tells right from wrong answers "
        "begins at zero and rises to the right.",
        [partial(_draw_selective_risk, comparison=comparison, ranking=ranking) for ranking in RANKINGS],
        {name: _colour(comparison.deciders.index(name)) for name in names},
        size=(_WIDTH / 1.4, 3.0),
    )


def _draw_selective_risk(axes: Axes, comparison: Summary, ranking: str) -> None:
    for name, found in comparison.selective.items():
        if found is not None and ranking in found.curves:
            curve = found.curves[ranking]
            axes.plot(curve.coverage, curve.risk, color=_colour(comparison.deciders.index(name)))
    axes.set(xlabel=f"coverage, by {ranking}", ylabel="fraction of wrong answers", xlim=(0, 1.02))
    top = max(axes.get_ylim()[1], 0.01)
    axes.set_ylim(-0.03 * top, top)  # a curve at zero is not hidden by the axis


def _whiskers(
    axes: Axes,
    values: Sequence[float],
    y: Sequence[float],
    intervals: Sequence[tuple[float, float]],
    index: int,
    label: str,
) -> None:
    x, (low, high) = np.array(values), np.array(intervals).T
    axes.errorbar(x, y, xerr=[x - low, high - x], **_style(index), label=label)


def _plain_numbers(axis: Axis) -> None:
    """Label a logarithmic axis with 0.01, not with powers, which take a tenth of a report's time to typeset."""
    axis.set_major_formatter("{x:g}")
    low, high = axis.get_view_interval()
    between = "235" if high < 10 * low else ""  # also 0.2, 0.3 and 0.5 where less than a decade is shown
    axis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in between else "")


def _style(index: int) -> dict[str, Any]:
    """Colour and marker of a decider; the marker helps readers who cannot tell the colours apart."""
    marker = _MARKERS[index % len(_MARKERS)]
    return {"color": _colour(index), "marker": marker, "linestyle": "none", "markersize": 5, "linewidth": 1.3}


def _colour(index: int) -> str:
    return PALETTE[index % len(PALETTE)]


def _offset(index: int, count: int) -> float:
    """Offset of the marker of one of several deciders, around 0."""
    return 0.7 * ((index + 0.5) / count - 0.5)


def _earlier(index: int, count: int) -> float:
    """1 for what is drawn first, 0 for the last: what is drawn earlier is larger, so that nothing is hidden."""
    return (count - 1 - index) / max(count - 1, 1)


def _legend(axes: Axes, comparison: Summary) -> None:
    widest = 0.55 + 0.075 * max(map(len, comparison.deciders))  # inches
    columns = min(max(int(_WIDTH / widest), 1), len(comparison.deciders))
    axes.legend(frameon=False, ncols=columns, loc="lower center", bbox_to_anchor=(0.5, 1), fontsize=9)
