"""The formats of recorded touches. To add one, write a function in a file of its own and add a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

from activetouch.errors import BadRecording
from activetouch.recorded.bts3 import read_bts3
from activetouch.recorded.csv_format import read_csv
from activetouch.recorded.named_columns import features_read
from activetouch.recorded.npz_format import read_npz
from activetouch.recorded.session_log import read_session_logs
from activetouch.recorded.touches import RecordedTouches

Format: TypeAlias = Literal["csv", "npz", "bts3", "session"]

FORMATS: Mapping[str, Callable[[Path], tuple[RecordedTouches, tuple[str, ...]]]] = MappingProxyType(
    {"csv": read_csv, "npz": read_npz, "bts3": read_bts3, "session": read_session_logs}
)
"""Functions that read a folder: they return the touches, and sentences about what was left out."""
assert tuple(FORMATS) == get_args(Format)


def read_recorded(data: str | Path, format: str) -> tuple[RecordedTouches, tuple[str, ...]]:
    """Recorded touches from a folder, and sentences about what was read, what was left out, and suspicious features.

    Args:
        data: folder of the recordings; for ``npz`` also the file.
        format: a key of :data:`FORMATS`.

    Raises:
        BadRecording: an unknown format, or data that are not in it.
    """
    if format not in FORMATS:
        raise BadRecording(f"unknown format {format!r}; known are {', '.join(FORMATS)}")
    touches, notes = FORMATS[format](Path(data))
    return touches, (features_read(touches), *notes)
