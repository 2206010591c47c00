"""One style for all figures, and how they are drawn, shown on a page and written."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from belief.files import atomic_path

# Colour-blind safe (Okabe and Ito 2008).
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
INK = "#010203"
"""Stands for the page's text colour; :func:`svg` replaces it by currentColor."""
STYLE: Any = {
    "font.size": 10.0,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "activetouch",
} | dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK)


@contextmanager
def figure(size: tuple[float, float], *paths: Path, dpi: int = 130) -> Iterator[Figure]:
    """A figure in the style of all, written to files when the block ends; equal content gives equal SVG.

    Args:
        size: width and height [inches].
        paths: files to write, atomically; the ending decides the format.
        dpi: pixels per inch of PNG files.

    Raises:
        CannotWrite: there is no room, or no permission.
    """
    with matplotlib.rc_context(STYLE):
        drawn = Figure(figsize=size, layout="constrained")
        yield drawn
        for path in paths:
            with atomic_path(path) as temporary:
                drawn.savefig(temporary, dpi=dpi, metadata={"Date": None} if path.suffix == ".svg" else None)


def svg(drawn: Figure, prefix: str = "") -> str:
    """A figure as inline SVG, its text in the colour of the page's.

    Args:
        drawn: figure to show.
        prefix: of its ids, which must differ from those of other figures of the page.
    """
    buffer = io.StringIO()
    with matplotlib.rc_context(STYLE):
        drawn.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :].replace(INK, "currentColor")
    return re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{prefix}-", text) if prefix else text


@dataclass(frozen=True)
class Picture:
    """Panels with one caption and one legend: one below the other on a narrow page, side by side in a file.

    Attributes:
        name: stem of its files.
        caption: what it shows.
        panels: functions that draw on axes of their own.
        legend: colour by name; none if empty.
        size: width and height of a panel [inches].
    """

    name: str
    caption: str
    panels: Sequence[Callable[[Axes], None]]
    legend: Mapping[str, str] = field(default_factory=dict)
    size: tuple[float, float] = (4.0, 3.2)

    def inline(self) -> list[str]:
        """Every panel as SVG for a page, which shows the legend itself."""
        found = []
        for number, draw in enumerate(self.panels):
            with figure(self.size) as drawn:
                draw(drawn.subplots())
                found.append(svg(drawn, f"{self.name}{number}"))
        return found

    def write(self, folder: Path) -> None:
        """Write NAME.svg and NAME.png.

        Raises:
            CannotWrite: there is no room, or no permission.
        """
        (width, height), count = self.size, len(self.panels)
        columns = 4 * count - 1 if count > 1 else 2
        size = (max(width * count, 5.2), height + 0.3 * np.ceil(len(self.legend) / columns))
        with figure(size, *(folder / f"{self.name}.{suffix}" for suffix in ("svg", "png"))) as drawn:
            for draw, axes in zip(self.panels, drawn.subplots(1, count, squeeze=False)[0], strict=True):
                draw(axes)
            if self.legend:
                lines = [Line2D([], [], color=colour, linewidth=3) for colour in self.legend.values()]
                drawn.legend(lines, list(self.legend), loc="outside upper center", ncols=columns, frameon=False)
