"""Ranges of command-line arguments: declared in their annotations, and checked before a command does anything.

A command begins its work with :func:`check_arguments`. To give an argument a range, annotate it: ``jobs: Jobs``,
``success: Annotated[float, Within(0.0, 1.0)]``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol, TypeAlias, get_args, get_origin, get_type_hints, runtime_checkable

from belief.errors import ActiveTouchError


class BadArgument(ActiveTouchError, ValueError):
    """A command was given an argument that makes no sense; the message names the flag and the value."""


@runtime_checkable
class Rule(Protocol):
    """What an argument must be; metadata of its annotation."""

    def broken(self, value: Any) -> str | None:
        """What the value must be, after "must"; None if it is that."""


@dataclass(frozen=True)
class Within:
    """A number must lie in a range; of several numbers, each.

    Attributes:
        low, high: its ends.
        open_low, open_high: whether an end is left out.
    """

    low: float
    high: float
    open_low: bool = False
    open_high: bool = False

    def broken(self, value: Any) -> str | None:
        """See :class:`Rule`."""
        numbers = value if isinstance(value, tuple) else (value,)
        return None if all(map(self._holds, numbers)) else f"be in {self}"

    def _holds(self, number: float) -> bool:  # never true of NaN
        low = self.low < number if self.open_low else self.low <= number
        return low and (number < self.high if self.open_high else number <= self.high)

    def __str__(self) -> str:
        return f"{'(' if self.open_low else '['}{self.low}, {self.high}{')' if self.open_high else ']'}"


@dataclass(frozen=True)
class NotEmpty:
    """At least one value must be given."""

    def broken(self, value: Any) -> str | None:
        """See :class:`Rule`."""
        return None if value else "name at least one"


@dataclass(frozen=True)
class Ending:
    """The name of a file must have one of these endings, which decide the format."""

    endings: tuple[str, ...]

    def broken(self, value: Any) -> str | None:
        """See :class:`Rule`."""
        return None if value.suffix.lower() in self.endings else f"end in {' or '.join(self.endings)}"


Count: TypeAlias = Annotated[int, Within(1, 10**8)]
"""How many; at least one."""
CountOrNone: TypeAlias = Annotated[int, Within(0, 10**8)]
"""How many; zero leaves it out."""
Jobs: TypeAlias = Annotated[int, Within(1, 4096)]
"""Processes or threads."""
Seed: TypeAlias = Annotated[int, Within(0, 2**32 - 1)]
"""Of chance; one word, so that no two seeds share a key."""
Pixels: TypeAlias = Annotated[int, Within(1, 4096)]
"""Edge of an image."""
Positive: TypeAlias = Annotated[float, Within(0.0, math.inf, open_low=True, open_high=True)]
"""A finite number above zero."""
NotNegative: TypeAlias = Annotated[float, Within(0.0, math.inf, open_high=True)]
"""A finite number, at least zero."""
Share: TypeAlias = Annotated[float, Within(0.0, 1.0, open_low=True)]
"""Part of something: above zero, at most one."""
Picture: TypeAlias = Annotated[Path, Ending((".png", ".svg", ".pdf", ".jpg"))]
"""File for a figure."""
JSONFile: TypeAlias = Annotated[Path, Ending((".json",))]
"""File for numbers."""


def check_arguments(command: Any, prefix: str = "--") -> None:
    """Check every argument of a command against the rules in its annotation, those of nested groups included.

    Args:
        command: a dataclass.
        prefix: of its flags.

    Raises:
        BadArgument: one breaks its rule; the message names the flag, the rule and the value.
    """
    for flag, _, value, rules in arguments(command, prefix):
        for rule in rules:
            if value is not None and (must := rule.broken(value)) is not None:
                raise BadArgument(f"{flag} must {must}, got {_words(value)}")


def arguments(
    command: Any, prefix: str = "--", path: tuple[str, ...] = ()
) -> Iterator[tuple[str, tuple[str, ...], Any, list[Rule]]]:
    """Flag, attributes that lead to it, value and rules of every argument of a command, nested groups included."""
    annotations = get_type_hints(type(command), include_extras=True)
    for field in fields(command):
        value, metadata = getattr(command, field.name), list(_metadata(annotations[field.name]))
        flag = prefix + field.name.replace("_", "-")
        if is_dataclass(value):
            unnamed = any(getattr(one, "name", None) == "" for one in metadata)  # tyro.conf.arg(name="")
            yield from arguments(value, prefix if unnamed else f"{flag}.", (*path, field.name))
        else:
            yield flag, (*path, field.name), value, [one for one in metadata if isinstance(one, Rule)]


def _metadata(annotation: Any) -> Iterator[Any]:
    """All metadata in an annotation, that of the members of a union or tuple included."""
    if get_origin(annotation) is Annotated:
        yield from annotation.__metadata__
    for part in get_args(annotation):
        yield from _metadata(part)


def _words(value: Any) -> str:
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
