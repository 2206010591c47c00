"""Reports: sentences, tables and figures in one style, as one self-contained HTML page and as files beside it."""

from __future__ import annotations

import base64
import io
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from cycler import cycler

from belief.files import atomic_path, write_text
from belief.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    import matplotlib.style
    from matplotlib.figure import Figure

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
                from matplotlib.lines import Line2D

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


written: list[Path] = []
"""Pages that this process wrote, the latest last; ``activetouch COMMAND --open`` shows it."""


@dataclass(frozen=True)
class Section:
    """A section of a report; on the page, figures are side by side above the tables.

    A section without a title continues the one before it. On the page, text between backticks is code; ``folded`` are
    paragraphs that it shows on request, by the line that stands for them; ``films`` are for the template ``film.html``.
    """

    title: str
    sentences: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    folded: Mapping[str, Sequence[str]] = field(default_factory=dict)
    films: Sequence[Mapping[str, Any]] = ()


@dataclass(frozen=True)
class Report:
    """What a command found: the only writer of pages, tables and figures.

    The first sentence of the first section is the verdict. ``folders`` of tables and figures are empty for that of the
    page; ``markdown`` names a file with all sentences and tables, and ``files`` have further content, such as JSON, by
    name.
    """

    title: str
    sections: Sequence[Section]
    folders: tuple[str, str] = ("", "")
    markdown: str = ""
    files: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """Sentences and tables as Markdown."""
        pieces = [f"# {self.title}"]
        for section in self.sections:
            pieces += [f"## {section.title}"] * bool(section.title)
            pieces += [*section.sentences, *(table.markdown() for table in section.tables if table.rows)]
        return "\n\n".join(pieces)

    def _repr_html_(self) -> str:
        """Sentences and tables, for a notebook."""
        pieces = [f"<h3>{escape(self.title)}</h3>"]
        for section in self.sections:
            pieces += [f"<h4>{escape(section.title)}</h4>"] * bool(section.title)
            pieces += [f"<p>{with_code(escape(sentence))}</p>" for sentence in section.sentences]
            pieces += [table.html() for table in section.tables if table.rows]
        return "".join(pieces)

    def save(self, folder: Path) -> Path:
        """Write ``report.html``, tables as CSV and LaTeX, figures as SVG and PNG, and ``files``; return the page."""
        tables, figures = (folder / name for name in self.folders)
        for section in self.sections:
            for table in (table for table in section.tables if table.name):
                table.write_csv(tables / f"{table.name}.csv")
                write_text(tables / f"{table.name}.tex", f"{table.latex()}\n")
            for picture in (picture for picture in section.pictures if picture.is_file):
                picture.write(figures)
        if self.markdown:
            write_text(folder / self.markdown, f"{self}\n")
        for name, content in self.files.items():
            write_text(folder / name, content)
        write_text(page := folder / "report.html", self.html())
        written.append(page)
        return page

    def html(self) -> str:
        """The page."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        loader = PackageLoader("experiments")
        environment = Environment(loader=loader, undefined=StrictUndefined, autoescape=True, trim_blocks=True)
        environment.filters |= {"data_uri": data_uri, "anchor": anchor, "with_code": with_code}
        return environment.get_template("page.html").render(title=self.title, sections=self.sections)


class Reported(ABC):
    """A result with a report, as which it prints."""

    @abstractmethod
    def report(self) -> Report:
        """Its sentences, tables and figures."""

    def save(self, folder: Path | str) -> Path:
        """Write the report into a folder, see :meth:`Report.save`; return the path of the page."""
        return self.report().save(Path(folder))

    def __str__(self) -> str:
        return str(self.report())

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return self.report()._repr_html_()


def anchor(title: str) -> str:
    """The anchor of a heading.

    >>> anchor("Answers and “I do not know”")
    'answers-and-i-do-not-know'
    """
    return re.sub(r"[^\w]+", "-", title.lower()).strip("-")


def data_uri(content: str | bytes, kind: str) -> str:
    """Content as a ``data:`` URI.

    >>> data_uri("a", "text/csv")
    'data:text/csv;base64,YQ=='
    """
    raw = content.encode() if isinstance(content, str) else content
    return f"data:{kind};base64,{base64.b64encode(raw).decode()}"


def with_code(escaped: str) -> str:
    """HTML in which text between backticks is code.

    >>> with_code("a &lt; b: `a`")
    'a &lt; b: <code>a</code>'
    """
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escaped))
