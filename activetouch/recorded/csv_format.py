"""The format ``csv``: one row for each touch, in all ``.csv`` and ``.csv.gz`` files of a folder.

The first line names the columns. ``object`` is needed; ``action`` (by default all touches have one action), ``session``
(order of recording among the touches of an object and action), ``category`` and ``shape`` are optional; all others are
features.
"""

from __future__ import annotations

import csv
from array import array
from bisect import bisect
from pathlib import Path

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.bounded import Numbers, lines_of, require_folder, require_short
from activetouch.recorded.named_columns import NAMES, ignored, touches_of_columns
from activetouch.recorded.touches import RecordedTouches
from belief.files import plain_number


def read_csv(folder: Path) -> tuple[RecordedTouches, tuple[str, ...]]:
    """The touches of all CSV files of a folder.

    Raises:
        BadRecording: no file, a column without a name, different columns, a row of another length, or a feature that
            is not a number; the message names the file and the line.
    """
    require_folder(folder, "one or more .csv files, with the columns object, action, session and features")
    paths = sorted(path for end in ("*.csv", "*.csv.gz") for path in folder.glob(end))
    if not paths:
        raise BadRecording(f"there is no .csv or .csv.gz file in {folder}")
    header: list[str] = []
    columns: dict[str, list[str]] = {name: [] for name in NAMES}
    numbers, known = Numbers(), dict[str, str]()
    line_of, firsts = array("q"), list[int]()  # line of each row, and first row of each file
    for path in paths:
        lines = lines_of(path)
        names = _header(path, *next(lines, (1, "")))
        if header and names != header:
            raise BadRecording(f"{path} has the columns {names[:12]}, {paths[0]} has {header[:12]}")
        header = names
        features = [column for column, name in enumerate(header) if name not in columns]
        labels = [(columns[name], column) for column, name in enumerate(header) if name in columns]
        firsts.append(numbers.num_rows)
        for number, line in lines:
            cells = _cells(path, number, line)
            if len(cells) != len(header):
                raise BadRecording(f"line {number} of {path} has {len(cells)} cells, the header has {len(header)}")
            numbers.add([_number(cells[column], header[column], number, path) for column in features])
            for words, column in labels:
                cell = cells[column].strip()
                words.append(known.setdefault(cell, cell))  # once in memory
            line_of.append(number)
    if not numbers.num_rows:
        raise BadRecording(f"the CSV files in {folder} have no rows below their headers")

    def place(row: int) -> str:
        return f"line {line_of[row]} of {paths[bisect(firsts, row) - 1]}"

    names = [header[column] for column in features]
    table = numbers.table()
    if (wrong := np.argwhere(~np.isfinite(table))).size:
        row, column = wrong[0].tolist()
        raise BadRecording(f"{place(row)}: the feature {names[column]!r} is '{table[row, column]}', not finite")
    for name, words in columns.items():
        require_short(name, max(map(len, words), default=0), numbers.num_rows, str(folder))
    given = {name: np.array(words) for name, words in columns.items() if words}
    touches = touches_of_columns(table, given, str(folder), place=place, feature_names=names)
    return touches, ignored("file", sorted(path.name for path in folder.iterdir() if path not in paths))


def _header(path: Path, number: int, line: str) -> list[str]:
    """The names of the columns."""
    names = [name.strip() for name in _cells(path, number, line)]
    if "object" not in names or len(set(names)) < len(names):
        raise BadRecording(
            f"the first line of {path} must name the columns, each once, separated by commas, with 'object' among "
            f"them; got {names[:12]}"
        )
    if "" in names:
        raise BadRecording(
            f"column {names.index('') + 1} of {path} has no name: name it or leave it out, as a row number is no "
            "feature (pandas writes none with to_csv(index=False))"
        )
    return names


def _number(cell: str, name: str, number: int, path: Path) -> float:
    """The decimal number in a cell."""
    try:
        return plain_number(cell)
    except ValueError:
        hint = " (decimals have a point)" if "," in cell else ""
        raise BadRecording(f"line {number} of {path}: the feature {name!r} is {cell[:40]!r}, no number{hint}") from None


def _cells(path: Path, number: int, line: str) -> list[str]:
    """The cells of a line."""
    try:
        return next(csv.reader([line]), [])
    except csv.Error as error:
        raise BadRecording(f"line {number} of {path} is not CSV: {error}") from error
