"""What takes long to compute is kept on disk for the next process: in ``$ACTIVETOUCH_CACHE``.

Without that variable it lies in the user's folder for caches. Deleting the folder loses nothing but time.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from belief.errors import CannotWrite, CorruptFile
from belief.sealed_tensors import read_tensors, write_tensors

_KIND, _NAME = "activetouch-cached-1", "array"
_ARRAY = ".safetensors"
_GEOMETRY = 2  # number of the rules by which shapes become height maps; values made by earlier ones are not read
T = TypeVar("T")


def cache_folder() -> Path:
    """Where it lies; where there is no home, in no folder, so that nothing is kept."""
    if given := os.environ.get("ACTIVETOUCH_CACHE"):
        return Path(given)
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not cache.is_absolute():  # as the XDG specification has it
        try:
            cache = Path.home() / ".cache"
        except RuntimeError:  # there is no home
            cache = Path(os.devnull)
    return cache / "activetouch"


def cached(
    key: Mapping[str, Any],
    suffix: str,
    make: Callable[[], T],
    read: Callable[[Path], T],
    write: Callable[[Path, T], None],
) -> T:
    """A value from the cache, or a new one, which is put there.

    Where nothing can be written, it is computed every time.

    Args:
        key: JSON values of everything that the value depends on.
        suffix: of the file.
        make: computes the value.
        read: from the file; raises CorruptFile, KeyError, OSError or ValueError where it is missing or damaged.
        write: to the file.
    """
    path = _place(key, suffix)
    try:
        return read(path)
    except (CorruptFile, KeyError, OSError, ValueError):
        found = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, found)
    except (CannotWrite, OSError):
        pass
    return found


def _place(key: Mapping[str, Any], suffix: str) -> Path:
    versioned = {**key, "geometry": _GEOMETRY}
    digest = hashlib.sha256(json.dumps(versioned, sort_keys=True).encode()).hexdigest()
    return cache_folder() / f"{digest}{suffix}"


def has_array(key: Mapping[str, Any]) -> bool:
    """Whether the cache has a file for :func:`cached_array`."""
    return _place(key, _ARRAY).is_file()


def cached_array(key: Mapping[str, Any], make: Callable[[], NDArray[np.float32]]) -> NDArray[np.float32]:
    """An array from the cache, or a new one; in half precision either way. See :func:`cached`."""
    found = cached(
        key,
        _ARRAY,
        make=lambda: make().astype(np.float16),
        read=lambda path: read_tensors(path, _KIND)[0][_NAME],
        write=lambda path, array: write_tensors(path, {_NAME: array}, {}, _KIND),
    )
    return found.astype(np.float32)
