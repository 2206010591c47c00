"""Tables as CSV that a spreadsheet shows, and never runs."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

_BEGINS_A_FORMULA = ("=", "+", "-", "@", "\t", "\n", "＝", "＋", "－", "＠")  # as OWASP lists them


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    r"""Rows as CSV, numbers in full; words that a spreadsheet would take for a formula get an apostrophe before them.

    >>> csv_text([("=1+1", -0.5, "-0.5")])
    "'=1+1,-0.5,-0.5\n"
    """
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([_harmless(cell) for cell in row] for row in rows)
    return text.getvalue()


def _harmless(cell: object) -> object:
    if not isinstance(cell, str) or _is_number(cell):
        return cell
    text = cell.replace("\r", "\n")  # the writer leaves it without quotation marks, where it would begin a row
    return f"'{text}" if text.startswith(_BEGINS_A_FORMULA) else text


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return cell == cell.strip()
