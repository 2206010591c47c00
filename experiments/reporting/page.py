"""One self-contained HTML page of words, tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from belief.files import write_text
from experiments.bayes_error.estimator import Grid
from experiments.reporting.csv_text import csv_text


@dataclass(frozen=True)
class Part:
    """A part of a page.

    Attributes:
        title: its heading.
        sentences: what it says.
        grids: tables.
        figures: inline SVG, side by side where there is room.
        caption: of the figures.
    """

    title: str
    sentences: Sequence[str] = ()
    grids: Sequence[Grid] = ()
    figures: Sequence[str] = ()
    caption: str = ""


def write_page(path: Path, title: str, parts: Sequence[Part]) -> None:
    """Write the page, atomically; it needs nothing beside it."""
    environment = Environment(
        loader=PackageLoader("experiments.reporting"), undefined=StrictUndefined, autoescape=True, trim_blocks=True
    )
    write_text(path, environment.get_template("page.html").render(title=title, parts=parts))


def write_csv(path: Path, grid: Grid) -> None:
    """Write a table for other programs, atomically."""
    write_text(path, csv_text([grid.headings, *grid.rows]))
