"""Which code an object runs: a digest of the modules that define its class, for what must know an edit from none."""

from __future__ import annotations

import hashlib
import re
import sys
from pathlib import Path
from types import CodeType, FunctionType

_PACKAGES = frozenset({"belief", "planners", "activetouch", "experiments"})
_ADDRESS = re.compile(" at 0x[0-9a-f]+")  # another one in every process


def is_own(thing: object) -> bool:
    """Whether the class of an object (or a class, or a function) is defined in this distribution.

    >>> from belief import Touch
    >>> is_own(Touch), is_own(hashlib.sha256)
    (True, False)
    """
    return _package(_kind(thing)) in _PACKAGES


def source_digest(thing: object) -> str:
    """SHA-256 of the source files that define the class of an object, with its base classes, or a function.

    Modules that these import are not followed, nor those of Python itself. Where there is no source file, as in an
    interactive session, the compiled code is taken.

    Args:
        thing: an object, a class, or a function.

    >>> from belief import Probe
    >>> source_digest(Probe(0)) == source_digest(Probe(1)) == source_digest(Probe)
    True
    """
    kind = _kind(thing)
    digest = hashlib.sha256(f"{kind.__module__}.{kind.__qualname__}".encode())
    for part in kind.__mro__ if isinstance(kind, type) else (kind,):
        if _package(part) not in sys.stdlib_module_names:
            file = getattr(sys.modules.get(part.__module__), "__file__", None)
            digest.update(_file_digest(file) or _code_digest(part))
    return digest.hexdigest()


def _kind(thing: object) -> type | FunctionType:
    return thing if isinstance(thing, type | FunctionType) else type(thing)


def _package(kind: type | FunctionType) -> str:
    return kind.__module__.partition(".")[0] if kind.__module__ != "__main__" else ""


def _file_digest(file: str | None) -> bytes | None:
    """Digest of a file's bytes; None if there is no such file."""
    try:
        return hashlib.sha256(Path(file).read_bytes()).digest() if file else None
    except OSError:
        return None


def _code_digest(kind: type | FunctionType) -> bytes:
    """Digest of the compiled functions of a class, and of its other members as they are written out."""
    members = vars(kind).items() if isinstance(kind, type) else [(kind.__name__, kind)]
    digest = hashlib.sha256()
    for name, member in sorted(members):
        inner = next((getattr(member, part) for part in ("fget", "func", "__func__") if hasattr(member, part)), member)
        code = getattr(inner, "__code__", None)
        if isinstance(code, CodeType):
            digest.update(f"{name} {_spelled(code)}".encode())
        elif not name.startswith("__"):
            digest.update(f"{name} {_ADDRESS.sub('', repr(member))}".encode())
    return digest.digest()


def _spelled(code: CodeType) -> str:
    constants = [_spelled(c) if isinstance(c, CodeType) else _ADDRESS.sub("", repr(c)) for c in code.co_consts]
    return f"{code.co_code.hex()} {code.co_names} {constants}"
