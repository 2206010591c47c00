"""Common style of all figures; drawing them, embedding them in pages and writing them to files."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from belief.files import atomic_path

# Colour-blind safe (Okabe and Ito 2008).
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
INK = "#010203"
"""Placeholder for the text colour, which is ``currentColor`` on pages."""
STYLE: Any = {
    "font.size": 10.0,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "activetouch",
    "pdf.fonttype": 42,  # TrueType, which publishers ask for
    "legend.fontsize": 9.0,
    "axes.prop_cycle": cycler(color=PALETTE),
} | dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK)


@contextmanager
def figure(
    size: tuple[float, float] | None, *paths: Path, dpi: int = 130, style: str | Path | None = None
) -> Iterator[Figure]:
    """A figure in the common style, whatever the user's is, with changes by ``style``; written to files at the end.

    The ending of a file decides its format; equal content gives equal SVG. Sizes are in inches.
    """
    with matplotlib.style.context(["default", STYLE, *([] if style is None else [style])]):
        drawn = Figure(figsize=size, layout="constrained")
        yield drawn
        for path in paths:
            with atomic_path(path) as temporary:
                temporary.write_bytes(_saved(drawn, path.suffix[1:], dpi))


@dataclass(frozen=True)
class Picture:
    """Panels of a figure, each drawn by a function, with one caption and one legend; ``size`` of a panel [inches].

    ``columns`` are of panels and of the legend; ``widths`` of panels in one row, relative to ``size``; ``is_file`` says
    whether a report writes it as files as well.
    """

    name: str
    caption: str
    panels: Sequence[Callable[[Axes], None]]
    legend: Mapping[str, str] = field(default_factory=dict)
    size: tuple[float, float] = (4.0, 3.2)
    columns: int | None = None
    is_file: bool = True
    widths: Sequence[float] = ()

    def inline(self) -> list[str]:
        """Every panel as SVG; the page shows the legend."""
        if len(self.panels) == 1 and not self.legend:
            return [_on_page(self._files["svg"], f"{self.name}0")]
        found = []
        for number, draw in enumerate(self.panels):
            wide = self.widths[number] if self.widths else 1.0
            with figure((wide * self.size[0], self.size[1])) as drawn:
                draw(drawn.subplots())
                found.append(_on_page(_saved(drawn, "svg"), f"{self.name}{number}"))
        return found

    def write(self, folder: Path) -> None:
        """Write NAME.svg and NAME.png."""
        for suffix, content in self._files.items():
            with atomic_path(folder / f"{self.name}.{suffix}") as temporary:
                temporary.write_bytes(content)

    @cached_property
    def _files(self) -> dict[str, bytes]:
        """All panels with the legend, by suffix; drawn once, which takes most of the time of a report."""
        (width, height), count = self.size, min(self.columns or len(self.panels), len(self.panels))
        rows = -(-len(self.panels) // count)
        columns = self.columns or (4 * count - 1 if count > 1 else 2)
        width *= sum(self.widths) if self.widths else count
        width = max(width, 5.2) if self.legend else width
        with figure((width, height * rows + 0.3 * np.ceil(len(self.legend) / columns))) as drawn:
            grid = drawn.subplots(rows, count, squeeze=False, width_ratios=self.widths or None).ravel()
            for draw, axes in zip(self.panels, grid, strict=False):
                draw(axes)
            for axes in grid[len(self.panels) :]:
                axes.set_axis_off()
            if self.legend:
                own = {n: one for axes in grid for one, n in zip(*axes.get_legend_handles_labels(), strict=True)}
                lines = [own.get(n) or Line2D([], [], color=c, linewidth=3) for n, c in self.legend.items()]
                drawn.legend(lines, list(self.legend), loc="outside upper center", ncols=columns, frameon=False)
            return {suffix: _saved(drawn, suffix) for suffix in ("svg", "png")}


def _saved(drawn: Figure, suffix: str, dpi: int = 130) -> bytes:
    """A figure as the content of a file; once saved, it keeps its layout, which takes half of the time."""
    buffer = io.BytesIO()
    drawn.savefig(buffer, format=suffix, dpi=dpi, metadata={"Date": None} if suffix == "svg" else None)
    drawn.set_layout_engine("none")
    return buffer.getvalue()


def _on_page(svg: bytes, prefix: str) -> str:
    """A figure as inline SVG: without a background, its text in the page's colour, its ids unique on the page."""
    text = svg.decode()
    text = text[text.index("<svg") :].replace(INK, "currentColor").replace('"fill: #ffffff"', '"fill: none"')
    return re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{prefix}-", text)
