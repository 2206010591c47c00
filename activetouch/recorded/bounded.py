"""Reading of files that others made: bounded in size, without running anything that they hold."""

from __future__ import annotations

import bz2
import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from activetouch.errors import BadRecording

MOST_BYTES = 256 * 2**20
"""Largest decompressed size of one file."""
_LONGEST_LINE = 2**22


def read_bounded(path: Path, most: int = MOST_BYTES) -> bytes:
    """The content of a file; of ``.gz`` and ``.bz2`` decompressed, never more than ``most`` bytes in memory.

    Raises:
        BadRecording: the file cannot be read or decompressed, or is larger.
    """
    try:
        with _opened(path) as file:
            content = file.read(most + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise BadRecording(f"{path} cannot be read: {error}") from error
    if len(content) > most:
        raise BadRecording(f"{path} holds more than {most} bytes when decompressed; such files are not read")
    return content


def lines_of(path: Path, most: int = MOST_BYTES) -> Iterator[tuple[int, str]]:
    """Numbered lines of a text file, from 1, without empty ones.

    Raises:
        BadRecording: as :func:`read_bounded`, text that is not UTF-8, or a line of more than 4 MiB.
    """
    try:
        text = read_bounded(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadRecording(f"{path} is not text in UTF-8, save it as such: {error}") from error
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > _LONGEST_LINE:
            raise BadRecording(f"line {number} of {path} has {len(line)} characters; {_LONGEST_LINE} are the most")
        if line.strip():
            yield number, line


def require_folder(folder: Path, what: str) -> Path:
    """The folder, if it is one.

    Raises:
        BadRecording: it is not there.
    """
    if not folder.is_dir():
        raise BadRecording(f"there is no folder {folder}; it must hold {what}")
    return folder


def _opened(path: Path) -> IO[bytes] | gzip.GzipFile | bz2.BZ2File:
    if path.suffix == ".gz":
        return gzip.open(path)
    if path.suffix in (".bz2", ".dsa"):
        return bz2.open(path)
    return path.open("rb")
