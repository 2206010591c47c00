"""Atomic writing of files, claims of folders, bounded reading of regular files, digests of JSON, arrays and source."""

from __future__ import annotations

import errno
import hashlib
import inspect
import io
import json
import os
import re
import stat
import sys
import tempfile
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from types import FunctionType
from typing import Any, ParamSpec, TypeVar
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from belief.codec import array_of
from belief.errors import ActiveTouchError, CannotWrite, CorruptFile

P = ParamSpec("P")
T = TypeVar("T")
BINARY = getattr(os, "O_BINARY", 0)
"""Flag of files opened by number: without it, Windows writes other line ends than it is given."""
_DECIMAL = re.compile(r"\s*[+-]?\d*([.,])\d+(?:[eE][+-]?\d+)?\s*", re.ASCII)


@contextmanager
def atomic_path(path: Path, *, only_new: bool = False) -> Iterator[Path]:
    """A temporary path beside ``path`` that replaces it when the block ends without an error.

    Parent folders are created. The data is flushed to disk before the rename, so a crash or a full disk leaves the old
    file unchanged.

    Args:
        path: file to write.
        only_new: whether to refuse to replace a file; of several processes that write ``path``, one succeeds.

    Raises:
        FileExistsError: with ``only_new``, the file exists.
        CannotWrite: the disk is full, the folder is read-only or not a folder, or similar. Other errors of the block
            are not changed.
    """
    temporary = None
    try:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
        except OSError as error:
            raise cannot_write(path, error) from error
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
        except Exception as error:
            if (cause := _cause(error, temporary)) is None:
                raise
            raise cannot_write(path, cause) from error
        try:
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
            temporary.chmod(0o644)  # mkstemp gives 0600, which other users cannot read
            if only_new:
                _link(temporary, path)
            temporary.replace(path)
        except OSError as error:
            if only_new and isinstance(error, FileExistsError):
                raise
            raise cannot_write(path, error) from error
    finally:
        if temporary is not None:
            with suppress(OSError):  # the disk may have become read-only
                temporary.unlink(missing_ok=True)


def _link(temporary: Path, path: Path) -> None:
    """Create ``path``; on a file system without hard links it is empty until it is replaced."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | BINARY))


def require_writable(folder: Path) -> None:
    """Raise CannotWrite unless files can be written into a folder; leaves no file and creates no folder."""
    existing = next(parent for parent in (folder, *folder.absolute().parents) if os.path.lexists(parent))
    try:
        with tempfile.TemporaryFile(dir=existing) as file:
            file.write(b"0")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise cannot_write(folder, error) from error


def require_writable_file(path: Path) -> None:
    """Raise CannotWrite unless a file can be written; leaves no file and creates no folder."""
    require_writable(path.parent)
    if path.is_dir():
        raise cannot_write(path, IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR)))


def cannot_write(path: Path, error: OSError) -> CannotWrite:
    """The error to raise after writing ``path`` failed, with the cause and a remedy."""
    if error.errno in (errno.EEXIST, errno.ENOTDIR, errno.EISDIR):
        blocking = next((p for p in (path, *path.parents) if os.path.lexists(p) and not p.is_dir()), None)
        cause = f"{blocking} is no folder, and none can be made there" if blocking else "it is a folder"
        return CannotWrite(f"{path} cannot be written: {cause}; choose another --out")
    cause = os.strerror(error.errno) if error.errno else str(error)
    remedy = "make room" if error.errno in _NO_ROOM else "allow writing there or choose another --out"
    return CannotWrite(
        f"{path} cannot be written: {cause}. What was there is kept; {remedy}, and run the same command to go on"
    )


_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def _cause(error: Exception, temporary: Path) -> OSError | None:
    """The operating system's error behind an error of writing ``temporary``; None if there is none."""
    if isinstance(error, ActiveTouchError):
        return None
    if isinstance(error, OSError) and error.errno is not None:
        return error if error.filename in (None, str(temporary), temporary) else None
    if isinstance(error, OSError) and re.fullmatch(r"\d+ requested and \d+ written", str(error)):
        return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    found = re.search(r"\(os error (\d+)\)", str(error))
    return OSError(int(found[1]), os.strerror(int(found[1]))) if found else None


def require_regular_file(path: Path, error: type[Exception] = CorruptFile) -> Path:
    """Refuse to read a path that is a folder, a pipe, a device or a socket; reading a pipe waits for ever.

    Returns:
        ``path``.

    Raises:
        error: by default CorruptFile; the path is there and is no regular file.
    """
    try:
        kind = stat.S_IFMT(path.stat().st_mode)
    except (OSError, ValueError):  # the reader says why it cannot be read
        return path
    if kind != stat.S_IFREG:
        remedy = "name a file in it" if kind == stat.S_IFDIR else "copy its content into a file and name that"
        raise error(f"{path} is {_KINDS.get(kind, 'a device')}, not a regular file; {remedy}")
    return path


_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}


def opened_zip(source: Path | bytes) -> zipfile.ZipFile:
    """A zip archive, from a file or its content, unless its list of names would take much memory.

    Raises:
        BadZipFile: the list is longer than a megabyte, or there is none.
    """
    with source.open("rb") if isinstance(source, Path) else io.BytesIO(source) as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - _LONGEST_END))
        end = file.read().rpartition(b"PK\5\6")[2]  # the record at the end of an archive
    if (length := int.from_bytes(end[8:12], "little")) > _LONGEST_LIST:
        raise zipfile.BadZipFile(f"its list of names has {length} bytes, and at most {_LONGEST_LIST} are read")
    return zipfile.ZipFile(source if isinstance(source, Path) else io.BytesIO(source))


_LONGEST_END, _LONGEST_LIST = (
    2**16 + 22,
    2**20,
)  # bytes of that record and of a list of names, which takes 20 times more


def read_npz(
    source: Path | bytes, most: int, names: Collection[str] | None = None
) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """The arrays of an npz file, those in ``names`` or all, and the names of others; raises many kinds of Exception.

    At most ``most`` bytes are decompressed, the headers of arrays included, of some hundred bytes each.
    """
    arrays: dict[str, NDArray[Any]] = {}
    with opened_zip(source) as archive:
        listed = [name.removesuffix(".npy") for name in archive.namelist()]
        if len(set(listed)) < len(listed):
            raise ValueError("it has two arrays of one name")
        others = [] if names is None else [name for name in listed if name not in names]
        for name in [name for name in listed if name not in others]:
            member = archive.getinfo(f"{name}.npy")
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"{name} is compressed in a way that numpy does not write")
            data = archive.open(member).read(most + 1)
            if (most := most - len(data)) < 0:
                raise ValueError("it would unpack to more bytes than such a file has")
            arrays[name] = _array(data)
    return arrays, others


def _array(data: bytes) -> NDArray[Any]:
    """The array of an npy file; its header may not promise another size than the file has, nor objects."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, is_fortran, dtype = read_header(stream)
    array = array_of(data[stream.tell() :], dtype, shape[::-1] if is_fortran else shape)
    return array.T if is_fortran else array


def write_text(path: Path, text: str) -> None:
    """Write a text file, atomically, with the same bytes on all systems."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(text.encode("utf-8"))


def in_file_name(text: str, keep: str = "") -> str:
    """Text as a part of a file name: different texts have different names, and none names another folder.

    Args:
        text: such as the label of a shape.
        keep: characters that stand as they are, beside letters, digits and "_"; all others are percent-encoded.

    >>> in_file_name("hex-nut", "-"), in_file_name("../100%")
    ('hex-nut', '%2E%2E%2F100%25')
    """
    return re.sub(rf"[^%\w{keep}]", lambda found: f"%{ord(found[0]):02X}", quote(text, safe=""), flags=re.ASCII)


def sealed_json(fields: Mapping[str, Any], indent: int | None = 1) -> str:
    """JSON text of ``fields``, which are JSON types, with their SHA-256, which :func:`unsealed_json` checks.

    Raises:
        ValueError: a number is not finite, or a key is ``sha256``.
    """
    if "sha256" in fields:
        raise ValueError("the key 'sha256' is taken by the digest")
    return json.dumps({**fields, "sha256": _json_digest(fields)}, indent=indent, allow_nan=False)


def unsealed_json(text: str) -> dict[str, Any]:
    """The fields of a text from :func:`sealed_json`, after a check of their digest.

    Raises:
        ValueError: the text is not a JSON object, has no digest, or was changed after it was written.
    """
    try:
        fields = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(fields, dict):
        raise ValueError(f"it is {type(fields).__name__}, not a JSON object")
    digest = fields.pop("sha256", None)
    if digest is None:
        raise ValueError("it has no SHA-256 of its content; create files of earlier versions again")
    if digest != _json_digest(fields):
        raise ValueError("it was changed after it was written: its content does not match its SHA-256")
    return fields


def _json_digest(fields: Mapping[str, Any]) -> str:
    """SHA-256 of the values, independent of spacing and order of keys."""
    try:
        text = json.dumps(fields, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return hashlib.sha256(text.encode()).hexdigest()


def array_digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of arrays: names, types, shapes and content, in the order of the names."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def plain_number(text: str) -> float:
    """The number that a text in a file writes in decimal digits, also ``nan`` and ``inf``.

    Python itself also reads ``1_000`` and the digits of other scripts, which in a file of numbers are mistakes.

    Raises:
        ValueError: it is not such a number.
    """
    try:
        if text.isascii() and "_" not in text:
            return float(text)
    except ValueError:
        pass
    raise ValueError(f"{text[:40]!r} is not a decimal number")


def decimal_mark(text: str) -> str:
    """The mark before the decimals of a text that is a number, a point or a comma; empty for any other text."""
    return found[1] if (found := _DECIMAL.fullmatch(text)) else ""


def source_digest(thing: object) -> str:
    """SHA-256 of the source files that define the class of an object, with its base classes, or a function.

    Modules that these import are left out, and so is the standard library. Where there is no source file, as in a
    notebook, the digest is of the source text; where there is none either, it is another one in every process.
    """
    kind = thing if isinstance(thing, type | FunctionType) else type(thing)
    digest = hashlib.sha256(f"{kind.__module__}.{kind.__qualname__}".encode())
    for part in kind.__mro__ if isinstance(kind, type) else (kind,):
        if not is_standard(part.__module__):
            digest.update(hashlib.sha256(_source(part)).digest())
    return digest.hexdigest()


def _source(part: type | FunctionType) -> bytes:
    try:
        return Path(str(getattr(sys.modules.get(part.__module__), "__file__", None))).read_bytes()
    except OSError:
        pass
    try:
        return inspect.getsource(part).encode()
    except (OSError, TypeError):
        return f"{id(part)}".encode()


OWN_PACKAGES = ("activetouch", "belief", "planners", "experiments")
"""The import packages of this project."""


def is_standard(name: str) -> bool:
    """Whether a module belongs to the Python standard library."""
    return name.partition(".")[0] in sys.stdlib_module_names


def is_installed(file: str) -> bool:
    """Whether a source file was installed with a package."""
    return bool({"site-packages", "dist-packages"} & set(Path(file).parts))


_CLAIMED: dict[Path, tuple[int | None, list[Path]]] = {}  # handle of each folder, and the folders created for it


def claim_folder(folder: Path) -> None:
    """Check that files can be written into a folder, and claim it for this process, which may claim it several times.

    The claim ends with the function decorated with :func:`ends_claims`, or with this process. Windows and some network
    file systems have no lock for a folder; there a claim does not exclude others.
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
