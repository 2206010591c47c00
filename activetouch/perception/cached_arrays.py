"""What takes long to make is kept: arrays on disk for the next process, in ``$ACTIVETOUCH_CACHE``; sessions in memory.

Without that variable it lies in the user's folder for caches. Deleting the folder loses nothing but time.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from belief.errors import CannotWrite, CorruptFile
from belief.sealed_tensors import read_tensors, write_tensors

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

_KIND, _NAME = "activetouch-cached-1", "array"
_ARRAY = ".safetensors"
_LINE, _IS_SAID = ContextVar("_LINE", default=""), ContextVar("_IS_SAID", default=False)
_EVERY = 0.5, 60.0  # seconds between two lines on what is done: on a terminal, where they replace each other; elsewhere
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


@contextmanager
def announced(line: str) -> Iterator[None]:
    """Print a line to stderr, once, as soon as something within the block is not in the cache and is computed."""
    line_before, said_before = _LINE.set(line), _IS_SAID.set(False)
    try:
        yield
    finally:
        _LINE.reset(line_before)
        _IS_SAID.reset(said_before)


def counted(items: Collection[T], what: str) -> Iterator[T]:
    """The items, one by one; of a computation that was announced, how many are done is printed to stderr."""
    begun = last = time.monotonic()
    is_terminal, width = sys.stderr.isatty(), 0
    for done, item in enumerate(items, 1):
        yield item
        now = time.monotonic()
        if _IS_SAID.get() and now - last >= _EVERY[not is_terminal]:
            left = (now - begun) * (len(items) - done) / done
            words = f"{what}: {done}/{len(items)}, about {left:.0f} s left"
            width, last = max(width, len(words)), now
            print(words.ljust(width), end="\r" if is_terminal else "\n", file=sys.stderr, flush=True)
    if is_terminal and width:
        print(" " * width, end="\r", file=sys.stderr, flush=True)


def cached(
    key: Mapping[str, Any],
    suffix: str,
    make: Callable[[], T],
    read: Callable[[Path], T],
    write: Callable[[Path, T], None],
) -> T:
    """A value from the cache, or a new one, which is put there.

    Where nothing can be written, it is computed every time. ``key`` are JSON values of everything that it depends on;
    their digest names the file. ``read`` raises where the file is missing or damaged, and checks with
    :func:`require_name` that it was not exchanged; ``write`` puts the name into it.
    """
    path = _place(key, suffix)
    try:
        return read(path)
    except (CorruptFile, KeyError, OSError, TypeError, ValueError):
        if line := _LINE.get():
            print(line, file=sys.stderr)
            _LINE.set("")
            _IS_SAID.set(True)
        found = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, found)
    except (CannotWrite, OSError):
        pass
    return found


def require_name(path: Path, name: object) -> None:
    """Raise ValueError unless a file of the cache holds its own name: then it was written for its key."""
    if name != path.stem:
        raise ValueError(f"{path} holds what was computed for another key")


def _place(key: Mapping[str, Any], suffix: str) -> Path:
    versioned = {**key, "geometry": _GEOMETRY}
    digest = hashlib.sha256(json.dumps(versioned, sort_keys=True).encode()).hexdigest()
    return cache_folder() / f"{digest}{suffix}"


def is_cached(key: Mapping[str, Any], suffix: str = _ARRAY) -> bool:
    """Whether the cache has a file for :func:`cached`, or for :func:`cached_array`."""
    return _place(key, suffix).is_file()


def cached_array(key: Mapping[str, Any], make: Callable[[], NDArray[np.float32]]) -> NDArray[np.float32]:
    """An array from the cache, or a new one; in half precision either way. See :func:`cached`."""

    def read(path: Path) -> NDArray[np.float16]:
        arrays, fields = read_tensors(path, _KIND)
        require_name(path, fields.get("name"))
        return arrays[_NAME]

    def write(path: Path, array: NDArray[np.float16]) -> None:
        write_tensors(path, {_NAME: array}, {"name": path.stem}, _KIND)

    return cached(key, _ARRAY, lambda: make().astype(np.float16), read, write).astype(np.float32)


@lru_cache(maxsize=16)
def session_of(network: bytes) -> InferenceSession:
    """A cached session of an ONNX graph, of one thread: processes share the cores, and sums keep their order."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads leave the cores alone
    options.use_deterministic_compute = True
    options.log_severity_level = 3  # errors
    return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])
