"""One table type for everything that is shown: in a terminal, on a page, as Markdown and as CSV."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from belief.files import write_text
from experiments.reporting.csv_text import csv_text

if TYPE_CHECKING:
    from rich.table import Table as RichTable

Value: TypeAlias = str | int | float | tuple[float, float] | None
"""A cell: a pair is an interval; None is shown as a dash."""


@dataclass(frozen=True)
class Table:
    r"""Rows of values under headings.

    Attributes:
        title: line above the table; none if empty.
        columns: headings; a pair of heading and format specification for a column of numbers, such as ``.3f``.
        rows: values in the order of the columns; a row of a single word heads the rows below it.
        note: explanation below the table.
        name: stem of its CSV file; a page offers the CSV of tables that have one.
        is_long: whether a page folds the table away.

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
    is_long: bool = False

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
        """Whether each column is of words: the first one, and those in which most cells begin with a letter."""
        cells = self.cells()
        letters = [
            2 * sum(row[place][:1].isalpha() for row in cells) > len(cells) for place in range(len(self.columns))
        ]
        return [
            column[1] == "" if isinstance(column, tuple) else place == 0 or letters[place]
            for place, column in enumerate(self.columns)
        ]

    def without(self, headings: Collection[str]) -> Table:
        """The table without the columns of these headings."""
        kept = [place for place, heading in enumerate(self.headings) if heading not in headings]
        rows = [row if len(row) == 1 else [row[place] for place in kept] for row in self.rows]
        return replace(self, columns=[self.columns[place] for place in kept], rows=rows)

    def rich(self) -> RichTable:
        """The table for a terminal; a word longer than the terminal is wide goes on in the next line."""
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
        for place, (heading, is_word) in enumerate(zip(self.headings, self.is_word, strict=True)):
            justify = "left" if is_word else "right"
            table.add_column(Text(heading), justify=justify, overflow="fold", no_wrap=place > 0 and not is_word)  # type: ignore[arg-type]
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
        """The values for other programs: intervals in two columns, numbers to the last digit, nothing for None."""
        pairs = [any(isinstance(row[place], tuple) for row in self.rows) for place in range(len(self.columns))]
        headings: list[list[str]] = [
            [f"{heading} low", f"{heading} high"] if pair else [heading]
            for heading, pair in zip(self.headings, pairs, strict=True)
        ]
        rows = [
            chain.from_iterable(
                (value if isinstance(value, tuple) else ("", "")) if pair else ("" if value is None else value,)
                for value, pair in zip(row, pairs, strict=True)
            )
            for row in self.rows
        ]
        return csv_text([tuple(chain.from_iterable(headings)), *map(tuple, rows)])

    def write_csv(self, path: Path) -> None:
        """Write the CSV, atomically.

        Raises:
            CannotWrite: there is no room, or no permission.
        """
        write_text(path, self.csv())


def interval(value: float, low: float, high: float, *, spec: str = ".3f") -> str:
    """A number with its interval, in one cell.

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
