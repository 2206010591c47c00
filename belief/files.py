"""Files that are written whole or not at all, and JSON that carries a digest of its content."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its place when the block ends without an error.

    Parent folders are made. The data is flushed to disk before the rename, so a crash or a full disk leaves
    the old file as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.chmod(0o644)  # mkstemp's 0600 would hide results from colleagues
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def sealed_json(fields: Mapping[str, Any], indent: int | None = 1) -> str:
    """JSON text of ``fields`` with a SHA-256 of them, which :func:`unsealed_json` checks.

    Args:
        fields: JSON types only; finite numbers; no key ``sha256``.
        indent: of the text; None for a single line.

    Raises:
        ValueError: a number is not finite, or a key is ``sha256``.

    >>> sealed_json({"temperature": 1.5}, indent=None)[:39]
    '{"temperature": 1.5, "sha256": "4f340e4'
    """
    if "sha256" in fields:
        raise ValueError("the key 'sha256' is taken by the digest")
    return json.dumps({**fields, "sha256": _json_digest(fields)}, indent=indent, allow_nan=False)


def unsealed_json(text: str) -> dict[str, Any]:
    """The fields from :func:`sealed_json`, once their digest is checked.

    Raises:
        ValueError: the text is no JSON object, carries no digest, or was changed after it was written.

    >>> unsealed_json(sealed_json({"temperature": 1.5}).replace("1.5", "1.6"))
    Traceback (most recent call last):
    ...
    ValueError: it was changed after it was written: its content does not match its SHA-256
    """
    try:
        fields = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(fields, dict):
        raise ValueError(f"it is {type(fields).__name__}, not a JSON object")
    digest = fields.pop("sha256", None)
    if digest is None:
        raise ValueError("it carries no SHA-256 of its content; files of earlier versions must be made again")
    if digest != _json_digest(fields):
        raise ValueError("it was changed after it was written: its content does not match its SHA-256")
    return fields


def _json_digest(fields: Mapping[str, Any]) -> str:
    """SHA-256 of the values themselves, however they are spaced or ordered in a file."""
    try:
        text = json.dumps(fields, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return hashlib.sha256(text.encode()).hexdigest()
