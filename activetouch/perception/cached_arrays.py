"""Arrays that take long to compute and are kept on disk for the next process: in ``$ACTIVETOUCH_CACHE``.

Without that variable they lie in the user's folder for caches. Deleting the folder loses nothing but time.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.sealed_tensors import read_tensors, write_tensors
from belief.errors import CannotWrite, CorruptFile

_KIND, _NAME = "activetouch-cached-1", "array"


def cache_folder() -> Path:
    """Where cached arrays lie; where there is no home, in no folder, so that nothing is kept."""
    if given := os.environ.get("ACTIVETOUCH_CACHE"):
        return Path(given)
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not cache.is_absolute():  # as the XDG specification has it
        try:
            cache = Path.home() / ".cache"
        except RuntimeError:  # there is no home
            cache = Path(os.devnull)
    return cache / "activetouch"


def cached_array(key: Mapping[str, Any], make: Callable[[], NDArray[np.float32]]) -> NDArray[np.float32]:
    """An array from the cache, or a new one, which is put there; in half precision either way.

    Where nothing can be written, it is computed every time.

    Args:
        key: JSON values of everything that the array depends on.
        make: computes it.
    """
    digest = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()
    path = cache_folder() / f"{digest}.safetensors"
    try:
        return read_tensors(path, _KIND)[0][_NAME].astype(np.float32)
    except (CorruptFile, KeyError):
        found = make().astype(np.float16)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_tensors(path, {_NAME: found}, {}, _KIND)
    except (CannotWrite, OSError):
        pass
    return found.astype(np.float32)
