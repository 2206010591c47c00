"""Shapes and poses by label or index, and seeds as one number or several."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import TypeAlias

from belief.errors import InvalidArgument, UnknownName

Name: TypeAlias = int | str
"""A shape or a pose: its index, or its label."""
_WIDTH = 118


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
