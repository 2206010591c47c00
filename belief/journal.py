"""An append-only file of JSON lines, each with its number and its SHA-256, each on disk before the next is begun.

A process that is killed, and a power failure, lose at most the line that was being written.

>>> import tempfile
>>> holder = tempfile.TemporaryDirectory()
>>> path = Path(holder.name, "log.jsonl")
>>> journal = Journal.create(path, [{"event": "begun"}])
>>> journal.append({"event": "touched"})
>>> journal.close()
>>> _ = path.write_bytes(path.read_bytes() + b'{"event": "tou')         # killed while it wrote
>>> journal, lines = Journal.opened(path)
>>> journal.append({"event": "touched again"})
>>> journal.close()
>>> [line["event"] for line in read_journal(path)]
['begun', 'touched', 'touched again']
>>> holder.cleanup()
"""

from __future__ import annotations

import os
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from belief.codec import array_field as array_field  # documented here
from belief.codec import array_from as array_from
from belief.errors import CannotWrite, CorruptFile
from belief.files import BINARY, atomic_path, cannot_write, lock, require_regular_file, sealed_json, unsealed_json

MOST_BYTES = 1 << 30
"""Largest journal that is read."""
_NUMBER = "line"


class Journal:
    """A journal open for appending, exclusively until :meth:`close` except on Windows and some network file systems."""

    def __init__(self, path: Path, handle: int, num_lines: int, size: int) -> None:
        self.path = path
        self._handle, self._num_lines, self._size = handle, num_lines, size
        self._close = weakref.finalize(self, os.close, handle)

    @classmethod
    def create(cls, path: Path, lines: Sequence[Mapping[str, Any]]) -> Journal:
        """A new journal with its first lines, which are JSON types; :func:`read_journal` returns them."""
        content = b"".join(_sealed(number, line) for number, line in enumerate(lines))
        try:
            with atomic_path(path, only_new=True) as temporary:
                temporary.write_bytes(content)
        except FileExistsError:
            raise CannotWrite(f"{path} exists and is not overwritten; name another file, or load it to go on") from None
        with suppress(OSError):  # a folder that cannot be flushed
            folder = os.open(path.parent, os.O_RDONLY)
            os.fsync(folder)
            os.close(folder)
        return cls(path, _locked(path), len(lines), len(content))

    @classmethod
    def opened(cls, path: Path) -> tuple[Journal, list[dict[str, Any]]]:
        """A journal to go on with, and its lines; a line that was begun and not finished is removed."""
        require_regular_file(path)
        handle = _locked(path)
        try:
            lines, size = _parsed(path)
            os.ftruncate(handle, size)
        except BaseException:
            os.close(handle)
            raise
        return cls(path, handle, len(lines), size), lines

    def append(self, line: Mapping[str, Any]) -> None:
        """Write a line; it is on disk when this returns."""
        content = _sealed(self._num_lines, line)
        try:
            done = 0
            while done < len(content):
                done += os.write(self._handle, content[done:])
            os.fsync(self._handle)
        except BaseException as error:  # Ctrl-C too: the next line has this one's number
            with suppress(OSError):
                os.ftruncate(self._handle, self._size)
            if isinstance(error, OSError):
                raise cannot_write(self.path, error) from error
            raise
        self._num_lines, self._size = self._num_lines + 1, self._size + len(content)

    def close(self) -> None:
        """Close the journal, so that others can open it."""
        self._close()


def read_journal(path: str | Path) -> list[dict[str, Any]]:
    """The finished lines of a journal, which may be open; raises CorruptFile for a changed, missing or foreign line."""
    return _parsed(require_regular_file(Path(path)))[0]


def _sealed(number: int, line: Mapping[str, Any]) -> bytes:
    return (sealed_json({_NUMBER: number, **line}, indent=None) + "\n").encode()


def _parsed(path: Path) -> tuple[list[dict[str, Any]], int]:
    """The finished lines, and their length in bytes."""
    try:
        if (size := path.stat().st_size) > MOST_BYTES:
            raise CorruptFile(f"{path} has {size} bytes; at most {MOST_BYTES} are read")
        content = path.read_bytes()
    except OSError as error:
        raise CorruptFile(f"{path} cannot be read: {error.strerror}") from error
    whole = content[: content.rfind(b"\n") + 1]
    lines = []
    for number, text in enumerate(whole.splitlines()):
        try:
            line = unsealed_json(text.decode("utf-8"))
            if (found := line.pop(_NUMBER, None)) != number:
                raise ValueError(f"it is line {found} of a journal")
        except ValueError as error:
            raise CorruptFile(f"line {number + 1} of {path} cannot be used: {error}") from error
        lines.append(line)
    if not lines:
        raise CorruptFile(f"{path} holds no finished line")
    return lines, len(whole)


def _locked(path: Path) -> int:
    """A handle that appends to a file, locked where files have locks."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_APPEND | BINARY)
    except OSError as error:
        raise cannot_write(path, error) from error
    lock(handle, f"{path} is in use: another process, or an open session of this one, writes to it; close that")
    return handle
