"""Tables of results: for the terminal, notebooks, pages, papers, and programs that go on computing.

What derives from :class:`Tabular` prints as its table, shows it in a notebook, and gives its rows.
"""

from __future__ import annotations

import csv
import html
import io
import re
import shutil
import textwrap
import unicodedata
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

from belief.files import write_text

Value: TypeAlias = str | int | float | tuple[float, float] | None
"""Content of a table cell: a pair is an interval; None is shown as a dash."""
_BEGINS_A_FORMULA = ("=", "+", "-", "@", "\t", "\n", "＝", "＋", "－", "＠")  # list of OWASP
_FILL = "\0"  # stands after each character that fills two places, while widths are computed
_LATEX = str.maketrans(
    {character: rf"\{character}" for character in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "…": r"\dots{}", "–": "--"}
    | {"≤": r"$\le$", "≥": r"$\ge$", "−": "$-$", "λ": r"$\lambda$", "ρ": r"$\rho$"}
)


@dataclass(frozen=True)
class Table:
    r"""Rows of values under headings.

    Attributes:
        title: line above the table; none if empty.
        columns: headings; for a column of numbers, a pair of heading and format specification such as ``.3f``; a third
            text is the name of the column in :meth:`records`.
        rows: values in the order of the columns; a row with a single value is a heading of the rows below it.
        note: explanation below the table.
        name: stem of the CSV file that a page offers; none if empty.

    >>> table = Table("Success", ["decider", ("success", ".2f"), ("95 %", ".2f")], [("greedy", 0.8125, (0.7, 0.9))])
    >>> print(table)
    Success
    decider  success         95 %
    ─────────────────────────────
    greedy      0.81  0.70 … 0.90
    >>> table.records()
    [{'decider': 'greedy', 'success': 0.8125, 'success_low': 0.7, 'success_high': 0.9}]
    >>> table.csv()
    'decider,success,success_low,success_high\ngreedy,0.8125,0.7,0.9\n'
    >>> print(table.markdown())
    **Success**
    <BLANKLINE>
    | decider | success | 95 % |
    | --- | ---: | ---: |
    | greedy | 0.81 | 0.70 … 0.90 |
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
            place == 0 or letters[place] if isinstance(column, str) else column[1] == ""
            for place, column in enumerate(self.columns)
        ]

    def without(self, headings: Collection[str]) -> Table:
        """The table without the columns that have these headings."""
        kept = [place for place, heading in enumerate(self.headings) if heading not in headings]
        rows = [row if len(row) == 1 else [row[place] for place in kept] for row in self.rows]
        return replace(self, columns=[self.columns[place] for place in kept], rows=rows)

    def __str__(self) -> str:
        return self.text()

    def text(self, width: int | None = None) -> str:
        """The table as plain text; what does not fit is wrapped, and nothing is cut.

        Args:
            width: of the longest line [characters]; that of the terminal by default, 80 where there is none.
        """
        most, count = shutil.get_terminal_size().columns if width is None else max(width, 1), len(self.columns)
        cells = [[_printable(cell) for cell in row] for row in (self.headings, *self.cells())]
        alone = [False, *(len(row) == 1 < count for row in self.rows)]
        columns = list(zip(*(row for row, single in zip(cells, alone, strict=True) if not single), strict=True))
        widths = [max(map(len, column)) for column in columns]
        longest = [max((len(word) for cell in column for word in cell.split()), default=1) for column in columns]
        for least in (longest, [1] * count):  # first lines break between words, then within them
            while sum(widths) + 2 * (count - 1) > most and (wide := [i for i in range(count) if widths[i] > least[i]]):
                widths[max(wide, key=widths.__getitem__)] -= 1
        is_word, lines = self.is_word, _wrapped(_printable(self.title), most) if self.title else []
        for number, row in enumerate(cells):
            if alone[number]:
                lines += _wrapped(row[0], most)
                continue
            parts = [_wrapped(cell, size) for cell, size in zip(row, widths, strict=True)]
            for place in range(max(map(len, parts), default=0)):
                line = [part[place] if place < len(part) else "" for part in parts]
                sides = zip(line, widths, is_word, strict=True)
                lines.append("  ".join(f"{one:{'<>'[not word]}{size}}" for one, size, word in sides).rstrip())
            if number == 0:
                lines.append("─" * (sum(widths) + 2 * (count - 1)))
        lines += _wrapped(_printable(self.note), most) if self.note else []
        return "\n".join(lines).replace(_FILL, "")

    def html(self) -> str:
        """The table as HTML, for a notebook."""
        sides = [f' style="text-align: {"left" if word else "right"}"' for word in self.is_word]
        head, *body = [
            "".join(f"<{tag}{side}>{html.escape(cell)}</{tag}>" for cell, side in zip(row, sides, strict=True))
            for tag, row in (("th", self.headings), *(("td", row) for row in self.cells()))
        ]
        title, note = (
            f"<{tag}>{html.escape(text)}</{tag}>" if text else ""
            for tag, text in (("caption", self.title), ("p", self.note))
        )
        rows = "".join(f"<tr>{row}</tr>" for row in body)
        return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{note}"

    def latex(self) -> str:
        r"""The table as a LaTeX ``tabular``, with the rules of the package booktabs; its title and note are comments.

        >>> print(Table("", ["decider", ("share", ".0%")], [("fixed_poses", 0.5)]).latex())
        \begin{tabular}{lr}
        \toprule
        decider & share \\
        \midrule
        fixed\_poses & 50\% \\
        \bottomrule
        \end{tabular}
        """
        cells = [[_printable(cell).replace(_FILL, "") for cell in row] for row in (self.headings, *self.cells())]
        alone = [False, *(len(row) == 1 < len(self.columns) for row in self.rows)]
        lines = [
            rf"\multicolumn{{{len(row)}}}{{l}}{{{_in_latex(row[0])}}} \\"
            if single
            else rf"{' & '.join(map(_in_latex, row))} \\"
            for row, single in zip(cells, alone, strict=True)
        ]
        sides = "".join("l" if word else "r" for word in self.is_word)
        body = [rf"\begin{{tabular}}{{{sides}}}", r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule"]
        said = [f"% {_printable(text).replace(_FILL, '')}" for text in (self.title, self.note) if text]
        return "\n".join([*said, *body, r"\end{tabular}"])

    def markdown(self) -> str:
        """The table as Markdown."""
        rule = ["---" if is_word else "---:" for is_word in self.is_word]
        rows = [[cell.replace("|", r"\|").replace("\n", " ") for cell in row] for row in (self.headings, *self.cells())]
        lines = [f"| {' | '.join(row)} |" for row in (rows[0], rule, *rows[1:])]
        return "\n".join(
            [*([f"**{self.title}**", ""] if self.title else []), *lines, *(["", self.note] if self.note else [])]
        )

    def records(self) -> list[dict[str, Any]]:
        """The rows as ``pandas.DataFrame`` takes them: numbers unrounded, an interval as two numbers."""
        names, rows = self._unrounded()
        return [dict(zip(names, row, strict=True)) for row in rows]

    def csv(self) -> str:
        """:meth:`records` as CSV; None is an empty cell."""
        names, rows = self._unrounded()
        return csv_text([names, *(["" if value is None else value for value in row] for row in rows)])

    def _unrounded(self) -> tuple[list[str], list[list[str | int | float | None]]]:
        """Names and values of all rows. An interval is named after the column before it, the number that it is of."""
        whole = [(*row, *[None] * (len(self.columns) - len(row))) for row in self.rows]
        pairs = [any(isinstance(row[place], tuple) for row in whole) for place in range(len(self.columns))]
        names = list[str]()
        for column, heading, pair in zip(self.columns, self.headings, pairs, strict=True):
            own = re.sub(r"\W+", "_", heading).strip("_") or heading
            own = names[-1] if pair and names else own
            names.append(own if isinstance(column, str) or len(column) < 3 else column[2])
        keys = [(f"{name}_low", f"{name}_high") if pair else (name,) for name, pair in zip(names, pairs, strict=True)]
        rows = [
            list(
                chain.from_iterable(
                    value if isinstance(value, tuple) else (value,) * len(key)
                    for value, key in zip(row, keys, strict=True)
                )
            )
            for row in whole
        ]
        return list(chain.from_iterable(keys)), rows

    def write_csv(self, path: Path) -> None:
        """Write the CSV, atomically."""
        write_text(path, self.csv())


class Tabular(ABC):
    """A result that prints as its table.

    >>> class Ages(Tabular):
    ...     def table(self):
    ...         return Table("", ["who", ("age", "d")], [("Ada", 36), ("Alan", 41)])
    >>> print(Ages())
    who   age
    ─────────
    Ada    36
    Alan   41
    >>> Ages().rows()
    [{'who': 'Ada', 'age': 36}, {'who': 'Alan', 'age': 41}]
    """

    @abstractmethod
    def table(self) -> Table:
        """The result as a table."""

    def __str__(self) -> str:
        return str(self.table())

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return self.table().html()

    def rows(self) -> list[dict[str, Any]]:
        """One dictionary for each row, numbers unrounded: ``pandas.DataFrame(result.rows())``."""
        return self.table().records()

    def to_latex(self) -> str:
        """The table as a LaTeX ``tabular``, with the rules of the package booktabs."""
        return self.table().latex()


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
    return f"{value:{spec}} [{', '.join(ends(low, high, spec))}]"


def ends(low: float, high: float, spec: str) -> tuple[str, str]:
    """Both ends of an interval as text, with as many more decimals as they need to differ.

    >>> ends(0.7, 0.9, ".2f"), ends(0.9962, 1.0, ".2f")
    (('0.70', '0.90'), ('0.996', '1.000'))
    """
    if (found := re.fullmatch(r"(.*\.)(\d)f", spec)) and low < high:
        decimals = next((n for n in range(int(found[2]), 10) if round(low, n) < round(high, n)), int(found[2]))
        spec = f"{found[1]}{decimals}f"
    return f"{low:{spec}}", f"{high:{spec}}"


def _text(value: Value, spec: str) -> str:
    if value is None:
        return "–"
    if isinstance(value, tuple):
        return " … ".join(ends(*value, spec))
    return f"{value:{spec}}"


def _printable(text: str) -> str:
    """Text whose length is its width: control characters become spaces, wide characters are followed by a filler."""
    plain = "".join(" " if unicodedata.category(one) == "Cc" else one for one in text)
    return "".join(one + _FILL if unicodedata.east_asian_width(one) in "WF" else one for one in plain)


def _wrapped(text: str, width: int) -> list[str]:
    """Lines of at most this length."""
    if _FILL in text and len(text) > width > 1:
        width -= 1  # a line may end with a wide character, and its filler begin the next
    return textwrap.wrap(text, width, break_on_hyphens=False, replace_whitespace=False) or [""]


def _in_latex(text: str) -> str:
    """Text as LaTeX prints it; leading spaces indent."""
    indent = r"\quad " if text.startswith(" ") else ""
    return indent + text.strip().translate(_LATEX)
