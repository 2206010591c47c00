"""Claims of folders: one process at a time writes its results into a folder."""

from __future__ import annotations

import os
import weakref
from contextlib import suppress
from pathlib import Path

from belief.errors import CannotWrite
from belief.files import cannot_write, require_writable


class FolderClaim:
    """Claim of this process to be the only writer of a folder; it ends with this object or with the process.

    Windows and some network file systems have no lock for a folder; there the claim does not exclude others.

    Args:
        folder: created if it does not exist; removed at the end of the claim if it was created and is empty.

    Raises:
        CannotWrite: another process has claimed the folder, or the folder cannot be created.
    """

    def __init__(self, folder: Path) -> None:
        created = [path for path in (folder, *folder.parents) if not path.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(folder, error) from error
        self._end = weakref.finalize(self, _release, _locked(folder), created)


def claim_folder(folder: Path) -> FolderClaim:
    """Check that files can be written into a folder, and that no other process writes there until the claim ends.

    Args:
        folder: of the results of a command; created if it does not exist.

    Returns:
        The claim; keep it until all files are written. A process may claim a folder several times.

    Raises:
        CannotWrite: the folder cannot be written, or another process has claimed it.
    """
    require_writable(folder)
    path = folder.resolve()
    if (claim := _CLAIMS.get(path)) is None:
        _CLAIMS[path] = claim = FolderClaim(path)
    return claim


_CLAIMS: weakref.WeakValueDictionary[Path, FolderClaim] = weakref.WeakValueDictionary()


def _locked(folder: Path) -> int | None:
    """A handle of a folder that is locked until the handle is closed; None where a folder has no locks."""
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # a folder that may be written and not be listed
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise CannotWrite(
            f"{folder} is in use: another process writes its results there. Wait until that process ends, or choose "
            "another --out"
        ) from error
    except OSError:  # the file system has no such locks
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
