"""Results of tasks in files, so that an interrupted command goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from belief.files import require_regular_file, sealed_json, unsealed_json, write_text
from experiments.search.fingerprint import files_digest, made_with


def results_folder(out: Path, sensor_files: list[Path]) -> Path:
    """Folder in ``out`` for what this code finds with the sensor in these files; another sensor or code has another."""
    words = json.dumps([files_digest(sensor_files), made_with()])
    return out / "searches" / hashlib.sha256(words.encode()).hexdigest()[:16]


def kept(folder: Path | None, words: list[Any], task: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The result of a task from its file, or else computed, and written there.

    Args:
        folder: of the files; None to keep nothing.
        words: what the result depends on beside the folder, as JSON types.
        task: its result is of JSON types.

    Raises:
        CannotWrite: the disk is full, or the folder cannot be written.
    """
    if folder is None:
        return task()
    path = folder / f"{hashlib.sha256(json.dumps(words).encode()).hexdigest()[:16]}.json"
    with suppress(OSError, ValueError):  # missing, or damaged
        return unsealed_json(require_regular_file(path).read_text(encoding="utf-8"))
    result = task()
    write_text(path, sealed_json(result) + "\n")
    return unsealed_json(path.read_text(encoding="utf-8"))
