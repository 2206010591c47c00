"""Digests of the code that an object runs: of its source files, or of functions and classes as loaded."""

from __future__ import annotations

import functools
import hashlib
import inspect
import re
import sys
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

_ADDRESS = re.compile(" at 0x[0-9a-f]+")  # differs between processes


def source_digest(thing: object) -> str:
    """SHA-256 of the source files that define the class of an object, with its base classes, or a function.

    Modules that these import are left out, and so is the standard library. Where there is no source file, as in an
    interactive session, the digest is of the compiled code.
    """
    kind = _kind(thing)
    digest = hashlib.sha256(f"{kind.__module__}.{kind.__qualname__}".encode())
    for part in kind.__mro__ if isinstance(kind, type) else (kind,):
        if not is_standard(part.__module__):
            file = getattr(sys.modules.get(part.__module__), "__file__", None)
            digest.update(_file_digest(file) or _code_digest(part))
    return digest.hexdigest()


def _kind(thing: object) -> type | FunctionType:
    return thing if isinstance(thing, type | FunctionType) else type(thing)


def _file_digest(file: str | None) -> bytes | None:
    """Digest of a file's bytes; None if there is no such file."""
    try:
        return hashlib.sha256(Path(file).read_bytes()).digest() if file else None
    except OSError:
        return None


def _code_digest(kind: type | FunctionType) -> bytes:
    """Digest of a function, or of the members of a class, as loaded."""
    members = vars(kind) if isinstance(kind, type) else {kind.__name__: kind}
    found = [(name, _loaded(value)) for name, value in sorted(members.items())]
    kept = [(name, one) for name, one in found if isinstance(one, list) or not name.startswith("__")]
    return hashlib.sha256(repr(kept).encode()).digest()


def _loaded(value: Any) -> Any:
    """What a member of a class runs, as a list, or holds, as text, without addresses and line numbers."""
    match value:
        case CodeType():
            return [value.co_code.hex(), value.co_names, [_loaded(one) for one in value.co_consts]]
        case property():
            return [_loaded(value.fget), _loaded(value.fset)]
        case functools.cached_property():
            return [_loaded(value.func)]
        case staticmethod() | classmethod():
            return [_loaded(value.__func__)]
        case frozenset():
            return str(sorted(map(repr, value)))
    function = value if isinstance(value, type) or not callable(value) else inspect.unwrap(value)
    if isinstance(function, FunctionType):
        return [_loaded(function.__code__), _loaded(function.__defaults__), _loaded(function.__kwdefaults__)]
    return _ADDRESS.sub("", repr(value))


def is_standard(name: str) -> bool:
    """Whether a module belongs to the Python standard library."""
    return name.partition(".")[0] in sys.stdlib_module_names
