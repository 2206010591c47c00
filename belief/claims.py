"""Claims of folders: one process at a time writes its results into a folder.

Windows and some network file systems have no lock for a folder; there a claim does not exclude others.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

from belief.errors import CannotWrite
from belief.files import cannot_write, require_writable

P = ParamSpec("P")
T = TypeVar("T")

_CLAIMED: dict[Path, tuple[int | None, list[Path]]] = {}  # handle of each folder, and the folders created for it


def claim_folder(folder: Path) -> None:
    """Check that files can be written into a folder, and claim it for this process, which may claim it several times.

    The claim ends with the function decorated with :func:`ends_claims`, or with this process.
    """
    require_writable(folder)
    if (path := folder.resolve()) in _CLAIMED:
        return
    created = [parent for parent in (path, *path.parents) if not parent.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    _CLAIMED[path] = _locked(path), created


def ends_claims(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator that ends the claims of a function with it, and removes folders created for them if they are empty."""

    @wraps(function)
    def with_claims(*args: P.args, **kwargs: P.kwargs) -> T:
        before = set(_CLAIMED)
        try:
            return function(*args, **kwargs)
        finally:
            for path in [path for path in _CLAIMED if path not in before]:
                _release(*_CLAIMED.pop(path))

    return with_claims


def lock(handle: int, in_use: str) -> bool:
    """Lock an open file or folder until its handle is closed; False where there are no such locks."""
    try:
        import fcntl
    except ImportError:  # Windows
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise CannotWrite(in_use) from error
    except OSError:  # the file system has none
        return False
    return True


def _locked(folder: Path) -> int | None:
    """A handle of a folder that is locked until the handle is closed; None where a folder has no locks."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # a folder that may be written and not be listed, and any folder on Windows
        return None
    told = (
        f"{folder} is in use: another process writes its results there. Wait until that process ends, or choose "
        "another --out"
    )
    if not lock(handle, told):
        os.close(handle)
        return None
    if folder.is_dir() and os.path.samestat(os.fstat(handle), folder.stat()):
        return handle
    os.close(handle)  # the folder was removed at the end of another claim
    folder.mkdir(parents=True, exist_ok=True)
    return _locked(folder)


def _release(handle: int | None, created: list[Path]) -> None:
    """Remove the created folders that are empty, then unlock."""
    with suppress(OSError):
        for folder in created:
            folder.rmdir()
    if handle is not None:
        os.close(handle)
