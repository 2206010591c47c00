"""Figures of a comparison, as inline SVG for the report and as files."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from belief.files import atomic_path
from experiments.search.summary import Comparison
from experiments.search.tables import ALL

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


_WIDTH = 5.2  # inches; narrow, so that letters stay readable on a phone
_MARKERS = "osD^vP*X"
_SMALLEST_ERROR = 1e-4


@dataclass(frozen=True)
class Picture:
    """A figure with its name and what is to be seen."""

    name: str
    caption: str
    figure: Figure

    @property
    def inline(self) -> str:
        """SVG for a page."""
        with matplotlib.rc_context(STYLE):
            return svg(self.figure, self.name)

    def write(self, folder: Path) -> None:
        """Write NAME.svg and NAME.png."""
        with matplotlib.rc_context(STYLE):
            for suffix in ("svg", "png"):
                with atomic_path(folder / f"{self.name}.{suffix}") as temporary:
                    self.figure.savefig(temporary, dpi=150, metadata={"Date": None} if suffix == "svg" else None)


def pictures(comparison: Comparison) -> list[Picture]:
    """All figures of a comparison."""
    num_deciders, num_groups = len(comparison.deciders), len(comparison.targets) + 1
    tall = 0.9 + 0.2 * num_deciders
    return [
        _draw("success", _SUCCESS, 1.0 + num_groups * (0.16 * num_deciders + 0.16), success, comparison),
        _draw("frontier", _FRONTIER, 3.4, frontier, comparison),
        _draw("positions", _POSITIONS, 2.6 + 0.1 * num_deciders, positions, comparison),
        _draw("touches", _TOUCHES, 2.6 + 0.1 * num_deciders, touches, comparison),
        _draw("promises", _PROMISES, tall + 0.3, promises, comparison),
        _draw("times", _TIMES, tall + 0.2, times, comparison),
    ]


_SUCCESS = "Success by target; whiskers are 95 % Wilson intervals, dotted lines the floor and the ceiling."
_FRONTIER = "Success against touches of a whole search, over all targets; up and to the left is better."
_POSITIONS = "Success by the place of the target in the order of visit; whiskers are 95 % Wilson intervals."
_TOUCHES = "Share of searches that took at most so many touches."
_PROMISES = (
    "Error of confirmations: promised (open), achieved with 95 % Clopper-Pearson intervals (filled). Errors below "
    f"{_SMALLEST_ERROR:g} are drawn there."
)
_TIMES = "Where the time of a touch goes."


def _draw(
    name: str, caption: str, height: float, panel: Callable[[Axes, Comparison], None], comparison: Comparison
) -> Picture:
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(_WIDTH, height), layout="constrained")
        panel(figure.subplots(), comparison)
        return Picture(name, caption, figure)


def success(axes: Axes, comparison: Comparison) -> None:
    """Success by target and decider, with intervals, floor and ceiling."""
    groups = [*comparison.targets, ALL]
    _floor_and_ceiling(axes.axvline, comparison)
    for index, decider in enumerate(comparison.deciders):
        y = np.arange(len(groups)) + _offset(index, len(comparison.deciders))
        cells = [comparison.cells[decider, group] for group in groups]
        _whiskers(axes, [c.success for c in cells], y, [c.success_interval for c in cells], index, decider)
    axes.set(xlabel="success", xlim=(-0.02, 1.02), yticks=np.arange(len(groups)), yticklabels=groups)
    axes.invert_yaxis()
    _legend(axes, comparison)


def frontier(axes: Axes, comparison: Comparison) -> None:
    """Success against touches."""
    _floor_and_ceiling(axes.axhline, comparison)
    for index, decider in enumerate(comparison.deciders):
        cell = comparison.cells[decider, ALL]
        low, high = cell.success_interval
        axes.errorbar(
            cell.touches, cell.success, [[cell.success - low], [high - cell.success]], **_style(index), label=decider
        )
    axes.set(xlabel="touches a search", ylabel="success", ylim=(-0.02, 1.04))
    axes.set_xlim(left=-0.04 * axes.get_xlim()[1])
    _legend(axes, comparison)


def positions(axes: Axes, comparison: Comparison) -> None:
    """Success by place of the target."""
    labels = list(dict.fromkeys(place.label for places in comparison.positions.values() for place in places))
    labels.sort(key=lambda label: (label == "absent", label.zfill(4)))
    for index, (decider, places) in enumerate(comparison.positions.items()):
        x = [labels.index(p.label) + _offset(index, len(comparison.deciders)) / 2 for p in places]
        bars = np.array([p.interval for p in places]).T
        values = np.array([p.success for p in places])
        axes.errorbar(x, values, [values - bars[0], bars[1] - values], **_style(index), label=decider)
    axes.set(xlabel="place of the target", ylabel="success", ylim=(-0.02, 1.04))
    axes.set_xticks(range(len(labels)), labels)
    _legend(axes, comparison)


def touches(axes: Axes, comparison: Comparison) -> None:
    """Distribution of touches."""
    for index, decider in enumerate(comparison.deciders):
        numbers = np.sort([episode.num_touches for episode in comparison.of(decider)])
        shares = np.arange(1, len(numbers) + 1) / len(numbers)
        axes.step([0, *numbers], [0, *shares], where="post", color=_colour(index), label=decider)
    axes.set(xlabel="touches", ylabel="share of searches", ylim=(0, 1.02))
    axes.set_xlim(left=0)
    _legend(axes, comparison)


def promises(axes: Axes, comparison: Comparison) -> None:
    """Promised and achieved error of confirmations."""
    names = [name for name, found in comparison.claims.items() if found is not None]
    for y, name in enumerate(names):
        score, index = comparison.claims[name].overall, comparison.deciders.index(name)
        achieved = max(1.0 - score.share_right, _SMALLEST_ERROR)
        bounds = (max(1.0 - score.high, _SMALLEST_ERROR), max(1.0 - score.low, _SMALLEST_ERROR))
        _whiskers(axes, [achieved], [y], [bounds], index, name)
        promised = max(1.0 - score.mean_stated, _SMALLEST_ERROR)
        axes.plot(promised, y, marker="D", markerfacecolor="none", markersize=8, color=_colour(index))
    axes.set(xscale="log", xlim=(_SMALLEST_ERROR / 1.3, 1.2), xlabel="error when confirming")
    axes.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.4, -0.6))


def times(axes: Axes, comparison: Comparison) -> None:
    """Milliseconds per touch, split into physics, network and decision."""
    names = [name for name in comparison.deciders if comparison.cells[name, ALL].seconds.num_touches]
    left = np.zeros(len(names))
    for part, colour in zip(("physics", "network", "decision"), PALETTE, strict=False):
        width = np.array([comparison.cells[name, ALL].seconds.ms_per_touch()[part] for name in names])
        axes.barh(names, width, left=left, color=colour, label=part, height=0.6)
        left += width
    axes.set(xlabel="ms a touch", ylim=(len(names) - 0.4, -0.6))
    axes.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1))


def _floor_and_ceiling(line: Callable[..., object], comparison: Comparison) -> None:
    solved, tried = comparison.ceiling
    for level in (comparison.floor, solved / tried):
        line(level, color=INK, linestyle=":", linewidth=1)


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


def _style(index: int) -> dict[str, object]:
    """Of one decider: a colour, and a marker for those who see none."""
    marker = _MARKERS[index % len(_MARKERS)]
    return {"color": _colour(index), "marker": marker, "linestyle": "none", "markersize": 5, "linewidth": 1.3}


def _colour(index: int) -> str:
    return PALETTE[index % len(PALETTE)]


def _offset(index: int, count: int) -> float:
    """Where the mark of one of several deciders stands, around 0."""
    return 0.7 * ((index + 0.5) / count - 0.5)


def _legend(axes: Axes, comparison: Comparison) -> None:
    widest = 0.55 + 0.075 * max(map(len, comparison.deciders))  # inches
    columns = min(max(int(_WIDTH / widest), 1), len(comparison.deciders))
    axes.legend(frameon=False, ncols=columns, loc="lower center", bbox_to_anchor=(0.5, 1), fontsize=9)


def svg(figure: Figure, prefix: str = "") -> str:
    """A figure as inline SVG, its text in the colour of the page's.

    Args:
        figure: to draw.
        prefix: for its ids, which must differ from those of other figures of the page.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :].replace(INK, "currentColor")
    return re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{prefix}-", text) if prefix else text
