"""Tables for the terminal, HTML pages, Markdown and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from belief.files import write_text

if TYPE_CHECKING:
    from rich.table import Table as RichTable

Value: TypeAlias = str | int | float | tuple[float, float] | None
"""Content of a table cell: a pair is an interval; None is shown as a dash."""
_BEGINS_A_FORMULA = ("=", "+", "-", "@", "\t", "\n", "＝", "＋", "－", "＠")  # list of OWASP


@dataclass(frozen=True)
class Table:
    r"""Rows of values under headings.

    Attributes:
        title: line above the table; none if empty.
        columns: headings; for a column of numbers, a pair of heading and format specification such as ``.3f``.
        rows: values in the order of the columns; a row with a single value is a heading of the rows below it.
        note: explanation below the table.
        name: stem of the CSV file that a page offers; none if empty.

    >>> table = Table("Success", ["decider", ("success", ".2f"), ("95 %", ".2f")], [("greedy", 0.8125, (0.7, 0.9))])
    >>> print(table.markdown())
    **Success**
    <BLANKLINE>
    | decider | success | 95 % |
    | --- | ---: | ---: |
    | greedy | 0.81 | 0.70 … 0.90 |
    >>> table.csv()
    'decider,success,95 % low,95 % high\ngreedy,0.8125,0.7,0.9\n'
    """

    title: str
    columns: Sequence[Sequence[str]]
    rows: Sequence[Sequence[Value]]
    note: str = ""
    name: str = ""

    @property
    def headings(self) -> list[str]:
        """Headings of the columns."""
        return [column if isinstance(column, str) else column[0] for column in self.columns]

    def cells(self) -> list[list[str]]:
        """Rows as text, all of the same length."""
        formats = ["" if isinstance(column, str) else column[1] for column in self.columns]
        return [
            [_text(value, spec) for value, spec in zip(row, formats, strict=len(row) > 1)]
            + [""] * (len(formats) - len(row))
            for row in self.rows
        ]

    @property
    def is_word(self) -> list[bool]:
        """For each column, whether it contains words: the first, and those whose cells mostly start with a letter."""
        cells = self.cells()
        letters = [
            2 * sum(row[place][:1].isalpha() for row in cells) > len(cells) for place in range(len(self.columns))
        ]
        return [
            column[1] == "" if isinstance(column, tuple) else place == 0 or letters[place]
            for place, column in enumerate(self.columns)
        ]

    def without(self, headings: Collection[str]) -> Table:
        """The table without the columns that have these headings."""
        kept = [place for place, heading in enumerate(self.headings) if heading not in headings]
        rows = [row if len(row) == 1 else [row[place] for place in kept] for row in self.rows]
        return replace(self, columns=[self.columns[place] for place in kept], rows=rows)

    def rich(self) -> RichTable:
        """The table for a terminal; what does not fit is wrapped, and nothing is cut."""
        from rich import box
        from rich.table import Table as RichTable
        from rich.text import Text

        table = RichTable(
            title=Text(self.title) if self.title else None,
            caption=Text(self.note) if self.note else None,
            title_justify="left",
            caption_justify="left",
            box=box.SIMPLE_HEAD,
            padding=(0, 0, 0, 1),
        )
        for heading, is_word in zip(self.headings, self.is_word, strict=True):
            justify = "left" if is_word else "right"
            table.add_column(Text(heading), justify=justify, overflow="fold")  # type: ignore[arg-type]
        for row, cells in zip(self.rows, self.cells(), strict=True):
            if len(row) == 1 and table.rows:
                table.rows[-1].end_section = True
            table.add_row(*map(Text, cells), style="bold" if len(row) == 1 else None)
        return table

    def markdown(self) -> str:
        """The table as Markdown."""
        rule = ["---" if is_word else "---:" for is_word in self.is_word]
        rows = [[cell.replace("|", r"\|").replace("\n", " ") for cell in row] for row in (self.headings, *self.cells())]
        lines = [f"| {' | '.join(row)} |" for row in (rows[0], rule, *rows[1:])]
        return "\n".join(
            [*([f"**{self.title}**", ""] if self.title else []), *lines, *(["", self.note] if self.note else [])]
        )

    def csv(self) -> str:
        """The table as CSV: intervals in two columns, numbers unrounded, None as an empty cell."""
        whole = [(*row, *[None] * (len(self.columns) - len(row))) for row in self.rows]
        pairs = [any(isinstance(row[place], tuple) for row in whole) for place in range(len(self.columns))]
        headings: list[list[str]] = [
            [f"{heading} low", f"{heading} high"] if pair else [heading]
            for heading, pair in zip(self.headings, pairs, strict=True)
        ]
        rows = [
            chain.from_iterable(
                (value if isinstance(value, tuple) else ("", "")) if pair else ("" if value is None else value,)
                for value, pair in zip(row, pairs, strict=True)
            )
            for row in whole
        ]
        return csv_text([tuple(chain.from_iterable(headings)), *map(tuple, rows)])

    def write_csv(self, path: Path) -> None:
        """Write the CSV, atomically.

        Raises:
            CannotWrite: The disk is full, or the folder is not writable.
        """
        write_text(path, self.csv())


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    r"""Rows as CSV; text that a spreadsheet would run as a formula gets a leading apostrophe.

    >>> csv_text([("=1+1", -0.5, "-0.5")])
    "'=1+1,-0.5,-0.5\n"
    """
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([_harmless(cell) for cell in row] for row in rows)
    return text.getvalue()


def _harmless(cell: object) -> object:
    if not isinstance(cell, str) or _is_number(cell):
        return cell
    text = cell.replace("\r", "\n")  # csv.writer does not quote "\r", which would start a new row
    return f"'{text}" if text.startswith(_BEGINS_A_FORMULA) else text


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return cell == cell.strip()


def interval(value: float, low: float, high: float, *, spec: str = ".3f") -> str:
    """A number and its interval as text.

    >>> interval(0.8125, 0.7, 0.9)
    '0.812 [0.700, 0.900]'
    """
    return f"{value:{spec}} [{low:{spec}}, {high:{spec}}]"


def _text(value: Value, spec: str) -> str:
    if value is None:
        return "–"
    if isinstance(value, tuple):
        return f"{value[0]:{spec}} … {value[1]:{spec}}"
    return f"{value:{spec}}"
