"""The format ``csv``: one row for each touch, in all ``.csv`` and ``.csv.gz`` files of a folder.

The first line names the columns. ``object`` is needed; ``action`` (by default all touches have one action), ``session``
(order of recording among the touches of an object and action), ``category`` and ``shape`` are optional; columns whose
names begin with ``untouched:`` are a control; all others are features.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from activetouch.errors import BadRecording
from activetouch.recorded.bounded import lines_of, require_folder
from activetouch.recorded.named_columns import UNTOUCHED, touches_of_columns
from activetouch.recorded.touches import RecordedTouches

_NAMES = ("object", "action", "session", "category", "shape")


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
    columns: dict[str, list[str]] = {name: [] for name in _NAMES}
    numbers: list[list[float]] = []
    places: list[tuple[Path, int]] = []
    for path in paths:
        lines = lines_of(path)
        names = [name.strip() for name in _cells(path, *next(lines, (1, "")))]
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
        if header and names != header:
            raise BadRecording(f"{path} has the columns {names[:12]}, {paths[0]} has {header[:12]}")
        header = names
        for number, line in lines:
            cells = _cells(path, number, line)
            if len(cells) != len(header):
                raise BadRecording(f"line {number} of {path} has {len(cells)} cells, the header has {len(header)}")
            values = []
            for name, cell in zip(header, cells, strict=True):
                if name in columns:
                    columns[name].append(cell.strip())
                    continue
                try:
                    values.append(float(cell))
                except ValueError:
                    raise BadRecording(
                        f"line {number} of {path}: the feature {name!r} is {cell[:40]!r}, no number"
                        + (" (decimals have a point)" if "," in cell else "")
                    ) from None
                if not np.isfinite(values[-1]):
                    raise BadRecording(f"line {number} of {path}: the feature {name!r} is {cell[:40]!r}, not finite")
            numbers.append(values)
            places.append((path, number))
    if not numbers:
        raise BadRecording(f"the CSV files in {folder} have no rows below their headers")
    features = [name for name in header if name not in columns]
    is_control = np.array([name.startswith(UNTOUCHED) for name in features], np.bool_)
    table = np.array(numbers).reshape(len(numbers), -1)
    given = {name: np.array(cells) for name, cells in columns.items() if cells}

    def place(row: int) -> str:
        path, number = places[row]
        return f"line {number} of {path}"

    return touches_of_columns(table[:, ~is_control], table[:, is_control], given, str(folder), place), ()


def _cells(path: Path, number: int, line: str) -> list[str]:
    """The cells of a line."""
    try:
        return next(csv.reader([line]), [])
    except csv.Error as error:
        raise BadRecording(f"line {number} of {path} is not CSV: {error}") from error
