"""Shapes and poses by label or index; names in messages; names of packages that load their modules at first use."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from numbers import Integral
from typing import Any, TypeAlias

from belief.errors import InvalidArgument, UnknownName

Name: TypeAlias = int | str
"""A shape or a pose: its index, or its label."""
UNKNOWN, UNLISTED = -1, -2
"""Mark an object in an arrangement: nobody knows its shape, and its shape is none of the listed ones."""
NONE_OF_THESE = "none of these"
"""In words: a shape that is not listed."""
_WIDTH = 118


def shape_name(labels: Sequence[str], shape: int) -> str:
    """The label of a shape by its index in an arrangement, or that it is none of these.

    >>> [shape_name(("sphere", "cone"), shape) for shape in (1, UNLISTED)]
    ['cone', 'none of these']
    """
    return NONE_OF_THESE if shape == UNLISTED else labels[shape]


def index_of(kind: str, labels: Sequence[str], name: Name) -> int:
    """The index of a label; an index is checked and returned.

    Args:
        kind: "shape", "pose" or "target", for messages.
        labels: all labels, in index order.
        name: a label, or an index.

    >>> index_of("shape", ("sphere", "cone"), "cone"), index_of("shape", ("sphere", "cone"), 0)
    (1, 0)
    """
    if isinstance(name, str):
        if name not in labels:
            raise UnknownName(kind, name, list(labels))
        return list(labels).index(name)
    if not isinstance(name, Integral) or isinstance(name, bool):
        raise InvalidArgument(f"{kind} must be one of {', '.join(labels)}, or its index; got {name!r}")
    if not 0 <= name < len(labels):
        raise InvalidArgument(f"{kind} must be in [0, {len(labels)}), got {name}")
    return int(name)


def checked_names(name: str, labels: Sequence[str]) -> tuple[str, ...]:
    """Labels as a tuple of one or more different strings."""
    names = labels if isinstance(labels, str) else tuple(labels)
    if isinstance(names, str) or not names or not all(isinstance(label, str) for label in names):
        raise InvalidArgument(f"{name} must be a sequence of names, at least one, got {labels!r}")
    if len(set(names)) < len(names):
        raise InvalidArgument(f"{name} must differ from each other, got {list(names)}")
    return names


def one_line(cls: type, *parts: str) -> str:
    """A representation of an object in at most 118 characters."""
    text = f"{cls.__name__}({', '.join(parts)})"
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 2]}…)"


def shown(value: object) -> str:
    """What was given, for an error: at most 80 characters, also of integers that Python does not print.

    >>> shown(10**5000)
    'a number with too many digits to print'
    """
    try:
        return f"{value!r:.80}"
    except ValueError:
        return "a number with too many digits to print"


def few(labels: Sequence[str], most: int = 4) -> str:
    """The first labels, and the number of further ones."""
    shown = ", ".join(labels[:most])
    return shown if len(labels) <= most else f"{shown} and {len(labels) - most} more"


def later(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """``__getattr__`` and ``__dir__`` of a package: the names that it imports under TYPE_CHECKING load at first use."""
    module = sys.modules[package]

    @cache
    def homes() -> dict[str, str]:
        blocks = [node.body for node in ast.parse(inspect.getsource(module)).body if isinstance(node, ast.If)]
        imports = [node for body in blocks for node in body if isinstance(node, ast.ImportFrom)]
        return {alias.name: str(node.module) for node in imports for alias in node.names}

    def load(name: str) -> Any:
        if name.startswith("__") or name not in homes():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        setattr(module, name, found := getattr(import_module(homes()[name]), name))
        return found

    return load, lambda: sorted({*vars(module), *homes()})
