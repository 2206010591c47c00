"""Reading of files that others made: bounded in size, without running anything that they hold."""

from __future__ import annotations

import gzip
import io
import zlib
from array import array
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from activetouch.errors import BadRecording
from belief.files import require_regular_file
from belief.validation import Floats

MOST_BYTES = 256 * 2**20
"""Largest decompressed size of one file."""
MOST_TOUCHES, MOST_NUMBERS, MOST_CHARACTERS = 2**20, 2**24, 2**26
"""Most touches of a set, most numbers of their features, and most characters of a column of names, each as long as the
longest."""
_LONGEST_LINE = 2**22


def lines_of(path: Path, most: int = MOST_BYTES) -> Iterator[tuple[int, str]]:
    """Numbered lines of a text file, from 1, without empty ones; one at a time in memory.

    Raises:
        BadRecording: the file cannot be read or decompressed, or holds more than ``most`` characters, text that is not
            UTF-8, a line of more than 4 MiB, or more than twice ``MOST_TOUCHES`` lines.
    """
    size = number = 0
    require_regular_file(path, BadRecording)
    try:
        with io.TextIOWrapper(
            gzip.open(path) if path.suffix == ".gz" else path.open("rb"), encoding="utf-8-sig"
        ) as text:
            while line := text.readline(_LONGEST_LINE + 1):
                number, size = number + 1, size + len(line)
                if len(line) > _LONGEST_LINE:
                    raise BadRecording(f"line {number} of {path} has more than {_LONGEST_LINE} characters")
                if size > most or number > 2 * MOST_TOUCHES:
                    raise BadRecording(
                        f"{path} holds more than {most} characters or {2 * MOST_TOUCHES} lines when decompressed; such "
                        "files are not read"
                    )
                if line.strip():
                    yield number, line.rstrip("\r\n")
    except UnicodeDecodeError as error:
        raise BadRecording(f"{path} is not text in UTF-8, save it as such: {error}") from error
    except (OSError, EOFError, zlib.error) as error:
        raise BadRecording(f"{path} cannot be read: {error}") from error


class Numbers:
    """The numbers of a table, which grows by rows and keeps 8 bytes for each number."""

    def __init__(self) -> None:
        self._numbers, self.num_rows = array("d"), 0

    def add(self, row: Iterable[float]) -> None:
        """Add a row.

        Raises:
            BadRecording: the table has more than ``MOST_TOUCHES`` rows or ``MOST_NUMBERS`` numbers.
        """
        self._numbers.extend(row)
        self.num_rows += 1
        require_bounded(self.num_rows, len(self._numbers), "these recordings")

    def table(self) -> Floats:
        """All rows, ``(n, F)``."""
        return np.array(self._numbers, np.float64).reshape(self.num_rows, -1)


def require_bounded(num_touches: int, num_numbers: int, source: str) -> None:
    """Refuse a set that is too large.

    Raises:
        BadRecording: there are more than ``MOST_TOUCHES`` touches or ``MOST_NUMBERS`` numbers.
    """
    if num_touches > MOST_TOUCHES or num_numbers > MOST_NUMBERS:
        raise BadRecording(
            f"{source} hold more than {MOST_TOUCHES} touches or {MOST_NUMBERS} numbers; leave out touches or features"
        )


def require_short(name: str, longest: int, num_touches: int, source: str) -> None:
    """Refuse a column of names that would need much memory as an array.

    Raises:
        BadRecording: as many names as there are touches have more than ``MOST_CHARACTERS`` characters if each is as
            long as the longest.
    """
    if longest * num_touches > MOST_CHARACTERS:
        raise BadRecording(
            f"{name} in {source} has a name of {longest} characters; of {num_touches} names each has at most "
            f"{MOST_CHARACTERS // num_touches}"
        )


def require_folder(folder: Path, what: str) -> Path:
    """The folder, if it is one.

    Raises:
        BadRecording: it is not there.
    """
    if not folder.is_dir():
        raise BadRecording(f"there is no folder {folder}; it must hold {what}")
    return folder
