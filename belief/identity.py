"""Digests of the code that an object runs: of source files, and of functions and classes as loaded."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

_ADDRESS = re.compile(" at 0x[0-9a-f]+")  # differs between processes
_PLAIN = (type(None), bool, int, float, complex, str, bytes)


def source_digest(thing: object) -> str:
    """SHA-256 of the source files that define the class of an object, with its base classes, or a function.

    Modules that these import are left out, and so is the standard library. Where there is no source file, as in an
    interactive session, the digest is of the compiled code.

    >>> from belief import Probe
    >>> source_digest(Probe(0)) == source_digest(Probe(1)) == source_digest(Probe)
    True
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
    """Digest of a function or class as loaded, with the representation of a class's other attributes."""
    if isinstance(kind, FunctionType):
        return _sha256(json.dumps(function_code(kind))).encode()
    others = [
        f"{name} {_ADDRESS.sub('', repr(value))}"
        for name, value in sorted(vars(kind).items())
        if not (name.startswith("__") or _functions(value) or _is_plain(value))
    ]
    return _sha256(json.dumps([class_code(kind), others])).encode()


def is_standard(name: str) -> bool:
    """Whether a module belongs to the Python standard library.

    >>> is_standard("hashlib"), is_standard("belief.identity")
    (True, False)
    """
    return name.partition(".")[0] in sys.stdlib_module_names


def class_code(cls: type) -> list[Any]:
    """Code of the methods of a class, without its bases, and its plain attributes, as JSON types.

    >>> class Probing:
    ...     touches = 2
    >>> class_code(Probing)
    [['touches', '2']]
    """
    found: list[Any] = []
    for name, value in sorted(vars(cls).items()):
        functions = [one for one in _functions(value) if isinstance(one, FunctionType)]
        if functions:
            found.append([name, [function_code(one) for one in functions]])
        elif not name.startswith("__") and _is_plain(value):
            found.append([name, _plain(value)])
    return found


def _functions(value: Any) -> list[Callable[..., Any] | None]:
    if isinstance(value, property):
        return [value.fget, value.fset]
    if isinstance(value, functools.cached_property):
        return [value.func]
    if isinstance(value, staticmethod | classmethod):
        return [value.__func__]
    return [inspect.unwrap(value)] if callable(value) and not isinstance(value, type) else []


def function_code(function: Any) -> list[Any]:
    """Code of a function and its plain defaults, as JSON types; an empty list where there is no bytecode.

    >>> function_code(lambda x: x + 1) == function_code(lambda x: x + 2), function_code(len)
    (False, [])
    """
    code = getattr(function, "__code__", None)
    if code is None:
        return []
    defaults = [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()]
    return [_code(code), [_plain(value) for value in defaults if _is_plain(value)]]


def _code(code: CodeType) -> list[Any]:
    """Instructions of a function with the names and constants they use; where it stands does not matter."""
    constants = [_code(one) if isinstance(one, CodeType) else _plain(one) for one in code.co_consts]
    return [_sha256(code.co_code), list(code.co_names), constants]


def _is_plain(value: object) -> bool:
    return isinstance(value, _PLAIN) or (isinstance(value, tuple | frozenset) and all(map(_is_plain, value)))


def _plain(value: Any) -> Any:
    if isinstance(value, frozenset):
        return sorted(map(repr, value))
    return [_plain(one) for one in value] if isinstance(value, tuple) else repr(value)


def _sha256(content: str | bytes) -> str:
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()
