"""The one reader of named columns that others made: CSV, also compressed, and npz; bounded, and without running code.

Cells of CSV are separated by commas, or by semicolons or tabs; then numbers may have decimal commas.
Every message gives the file, the column and the line or row.
"""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from array import array
from bisect import bisect
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.errors import ActiveTouchError, InvalidArgument
from belief.files import decimal_mark, plain_number, read_npz, require_regular_file
from belief.naming import few
from belief.validation import Floats

MOST_BYTES = 256 * 2**20
"""Largest decompressed size of one file."""
MOST_ROWS, MOST_NUMBERS, MOST_CHARACTERS = 2**20, 2**24, 2**26
"""Most rows of a table, most of its numbers, and most characters of a column of names, each as long as the longest."""
_LONGEST_LINE = 2**22
_ENDS_A_LINE = re.compile("[\0\v\f\x1a\x1c-\x1e\x85\u2028\u2029\ufeff]")


@dataclass(frozen=True, eq=False)
class Columns:
    """n rows: arrays by name, each ``(n, …)`` or a fact of all rows; numbers ``(n, F)`` of columns with F headings.

    ``others`` are names in an npz that were not asked for. ``places`` are the line of each row, the first row of each
    file, and the files; they are empty for an npz.
    """

    source: str
    arrays: dict[str, NDArray[Any]]
    numbers: Floats
    headings: tuple[str, ...]
    others: tuple[str, ...] = ()
    places: tuple[Sequence[int], Sequence[int], Sequence[Path]] = ((), (), ())

    def place(self, row: int) -> str:
        """A row in a message, such as "line 7 of mugs.csv"."""
        lines, firsts, paths = self.places
        return f"line {lines[row]} of {paths[bisect(firsts, row) - 1]}" if lines else f"row {row} of {self.source}"


def read_columns(
    paths: Sequence[Path],
    names: Collection[str],
    error: type[ActiveTouchError],
    *,
    needed: Sequence[str],
    is_numeric: bool = False,
    is_case_kept: bool = True,
    hint: str = "",
) -> Columns:
    """The columns of some names in CSV files, whose rows follow each other, or the arrays in one ``.npz``.

    Text files have equal headers, in small letters unless ``is_case_kept``; the named columns are read as text, and all
    others, if ``is_numeric``, as numbers. A file without the ``needed`` names, or anything else that is no such table
    or too large, raises ``error``. ``hint`` says what works where a word stands for a number, or an array is missing;
    ``{}`` in it is the name of the column.
    """
    if paths[0].suffix == ".npz":
        return _of_npz(paths[0], names, error, needed, hint)
    header: list[str] = []
    texts: dict[str, list[str]] = {}
    numbers, known = array("d"), dict[str, str]()
    lines, firsts = array("q"), list[int]()
    for path in paths:
        rows = _rows(path, error)
        first = [name.strip() if is_case_kept else name.strip().lower() for name in next(rows, (1, []))[1]]
        if header and first != header:
            apart = [("also", set(first) - {*header}), ("not", {*header} - set(first))]
            words = [f"{word} {few(sorted(map(repr, own)))}" for word, own in apart if own] or [
                "the same in another order"
            ]
            raise error(f"{path} has other columns than {paths[0]}: {', and '.join(words)}")
        header = first
        _require_header(path, header, first if is_numeric else names, error, needed)
        labels = [(texts.setdefault(name, []), i) for i, name in enumerate(header) if name in names]
        rest = [i for i, name in enumerate(header) if is_numeric and name not in names]
        firsts.append(len(lines))
        for number, cells in rows:
            if len(cells) != len(header):
                raise error(f"line {number} of {path} has {len(cells)} cells, the header has {len(header)}")
            for i in rest:
                try:
                    numbers.append(plain_number(cells[i]))
                except ValueError:
                    advice = "" if any(map(str.isdigit, cells[i])) else hint.format(header[i])
                    advice = " (decimals have a point)" if "," in cells[i] else advice
                    advice = advice if cells[i].strip() else " (an empty cell: leave the line out, or fill it)"
                    raise error(
                        f"line {number} of {path}: the column {header[i]!r} is {cells[i][:40]!r}, no number{advice}"
                    ) from None
            for column, i in labels:
                cell = cells[i].strip()
                column.append(known.setdefault(cell, cell))  # once in memory
            lines.append(number)
            require_bounded(len(lines), len(numbers), str(path), error)
    for name, column in texts.items():
        _require_short(name, max(map(len, column), default=0), len(column), str(paths[0]), error)
    arrays: dict[str, NDArray[Any]] = {name: np.array(column, np.str_) for name, column in texts.items()}
    table = np.array(numbers, np.float64).reshape(len(lines), -1) if lines else np.empty((0, len(rest)))
    found = Columns(str(path), arrays, table, tuple(header[i] for i in rest), places=(lines, firsts, paths))
    if (wrong := np.argwhere(~np.isfinite(table))).size:
        row, place = wrong[0].tolist()
        raise error(
            f"{found.place(row)}: the column {found.headings[place]!r} is '{table[row, place]}', not finite (leave the "
            "line out, or fill it)"
        )
    return found


def _require_header(
    path: Path, header: Sequence[str], read: Collection[str], error: type[ActiveTouchError], needed: Sequence[str]
) -> None:
    if missing := [name for name in needed if name not in header]:
        raise error(
            f"{path} has no column {' and no column '.join(map(repr, missing))}: it must name the columns, each once, "
            f"separated by commas, with {', '.join(map(repr, needed))} among them; its first line is "
            f"{header[:12] or 'empty'}"
        )
    if "" in read:
        raise error(
            f"column {header.index('') + 1} of {path} has no name: name it or leave it out, as a row number is no "
            "feature (pandas writes none with to_csv(index=False))"
        )
    if twice := [name for name in header if name in read and header.count(name) > 1]:
        raise error(f"{path} has the column {twice[0]!r} {header.count(twice[0])} times; name each column once")


def _of_npz(
    path: Path, names: Collection[str], error: type[ActiveTouchError], needed: Sequence[str], hint: str
) -> Columns:
    require_regular_file(path, error)
    try:
        arrays, others = read_npz(path, MOST_BYTES, names)
        found = {name: _text(name, column, str(path), error) for name, column in arrays.items()}
    except error:
        raise
    except Exception as damage:  # readers of zip and npy raise a dozen kinds on damaged bytes
        raise error(f"{path} cannot be read as .npz of plain arrays: {damage}") from damage
    if missing := [name for name in needed if name not in arrays]:
        raise error(f"{path} has no array {missing[0]!r}; it has {few([*arrays, *others], 12) or 'none'}{hint}")
    for column in found.values():
        require_bounded(len(np.atleast_1d(column)), column.size, str(path), error)
    return Columns(str(path), found, np.empty((0, 0)), (), tuple(others))


def _text(name: str, column: NDArray[Any], source: str, error: type[ActiveTouchError]) -> NDArray[Any]:
    """An array whose bytes are text in UTF-8, and, in a column of names, NaN an empty cell."""
    if column.dtype.kind in "SU":
        longest = column.dtype.itemsize // np.dtype(f"{column.dtype.kind}1").itemsize
        _require_short(name, longest, column.size, source, error)
    if column.dtype.kind == "f" and column.ndim == 1 and np.isnan(column).any():
        return np.where(np.isnan(column), "", column.astype(str))
    return np.char.decode(column, "utf-8") if column.dtype.kind == "S" else column


def require_bounded(num_rows: int, num_numbers: int, source: str, error: type[ActiveTouchError]) -> None:
    """Refuse a table of more than ``MOST_ROWS`` rows or ``MOST_NUMBERS`` numbers."""
    if num_rows > MOST_ROWS or num_numbers > MOST_NUMBERS:
        raise error(
            f"{source} holds more than {MOST_ROWS} rows or {MOST_NUMBERS} numbers; leave out touches or features"
        )


def _require_short(name: str, longest: int, number: int, source: str, error: type[ActiveTouchError]) -> None:
    """Refuse a column of names that would need much memory as an array, where each is as long as the longest."""
    if longest * number > MOST_CHARACTERS:
        raise error(
            f"{name} in {source} has a name of {longest} characters; of {number} names each has at most "
            f"{MOST_CHARACTERS // number}"
        )


def _rows(path: Path, error: type[ActiveTouchError]) -> Iterator[tuple[int, list[str]]]:
    lines, begin = lines_of(path, error), list[str]()
    while not "".join(begin).strip() and (line := next(lines, "")):
        begin.append(line)
    header = "".join(begin[-1:])
    sign = next((sign for sign in ";\t" if sign in header and "," not in header), ",")
    try:
        rows = csv_rows(chain(begin, lines), sign)
        yield from rows if sign == "," else _with_points(rows)
    except InvalidArgument as wrong:
        raise error(f"{path}, {wrong}") from wrong


def _with_points(rows: Iterable[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
    """Rows in which the decimal commas of numbers are points."""
    marks = dict[str, str]()
    for number, cells in rows:
        for i, cell in enumerate(cells):
            if mark := decimal_mark(cell):
                marks[mark] = cell
                cells[i] = cell.replace(",", ".")
        if len(marks) > 1:
            raise InvalidArgument(
                f"line {number}: numbers have a decimal point, as {marks['.']}, and a decimal comma, as {marks[',']}; "
                "use one of them"
            )
        yield number, cells


def lines_of(path: Path, error: type[ActiveTouchError]) -> Iterator[str]:
    """Lines of a text file, one at a time in memory; of ``.gz`` decompressed.

    Raises ``error`` for a file that cannot be read, is too large or no UTF-8, or has too long a line.
    """
    size = number = 0
    require_regular_file(path, error)
    try:
        opened = gzip.open if path.suffix == ".gz" else open
        with io.TextIOWrapper(opened(path, "rb"), encoding="utf-8-sig") as text:
            while line := text.readline(_LONGEST_LINE + 1):
                number, size = number + 1, size + len(line)
                if len(line) > _LONGEST_LINE:
                    raise error(f"line {number} of {path} has more than {_LONGEST_LINE} characters")
                if size > MOST_BYTES or number > 2 * MOST_ROWS:
                    raise error(
                        f"{path} holds more than {MOST_BYTES} characters or {2 * MOST_ROWS} lines when "
                        "decompressed; such files are not read"
                    )
                yield line
    except UnicodeDecodeError as wrong:
        raise error(f"{path} is not text in UTF-8, save it as such: {wrong}") from wrong
    except (OSError, EOFError, zlib.error) as wrong:
        raise error(f"{path} cannot be read: {wrong}") from wrong


def csv_rows(lines: Iterable[str], sign: str = ",") -> Iterator[tuple[int, list[str]]]:
    r"""Rows of CSV, each with the number of its first line, from 1; the first names the columns. No row is blank.

    ``sign`` separates the cells.

    >>> list(csv_rows(["a,b\n", "\n", '1,"x\n', 'y"\n']))
    [(1, ['a', 'b']), (3, ['1', 'x\ny'])]
    """
    reader, last = csv.reader(lines, strict=True, delimiter=sign), 0
    try:
        for cells in reader:
            first, last = last + 1, reader.line_num
            for odd in filter(None, map(_ENDS_A_LINE.search, cells)):
                raise InvalidArgument(
                    f"line {first} holds the character U+{ord(odd[0]):04X} in {odd.string[:40]!r}; leave it out"
                )
            for parts in (re.split("\r\n|\r|\n", cell) for cell in (cells if last > first else ())):
                commas = max(part.count(sign) for part in (*parts, parts[0] + parts[-1]))
                if len(parts) > 1 and commas >= len(cells) - 1:
                    raise InvalidArgument(f"line {first}: a quotation mark is not closed before the rows below it")
            if "".join(cells).strip() or len(cells) > 1:
                yield first, cells
    except csv.Error as error:
        raise InvalidArgument(f"line {last + 1} is not CSV: {error} (is a quotation mark not closed?)") from error
