"""Digests of the source code of classes and functions."""

from __future__ import annotations

import hashlib
import inspect
import sys
from pathlib import Path
from types import FunctionType


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


def is_standard(name: str) -> bool:
    """Whether a module belongs to the Python standard library."""
    return name.partition(".")[0] in sys.stdlib_module_names
