"""Valid ranges of command-line arguments, declared in annotations such as ``jobs: Jobs``.

Every command calls :func:`check_arguments` before it starts work.

A command runs ``module:attribute`` of a file only if its own command line names or allows it (:class:`Trust`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from operator import le, lt
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_args, get_origin, get_type_hints

import tyro

from belief.errors import ActiveTouchError


class BadArgument(ActiveTouchError, ValueError):
    """An argument of a command is invalid; the message names the flag and the value."""


@dataclass(frozen=True)
class Within:
    """Range of a number, or of every number in a tuple; ``open_low`` and ``open_high`` exclude the ends."""

    low: float
    high: float
    open_low: bool = False
    open_high: bool = False

    def broken(self, value: Any) -> str | None:
        """See :data:`Rule`."""
        above, below = (lt if is_open else le for is_open in (self.open_low, self.open_high))
        numbers = value if isinstance(value, tuple) else (value,)
        if all(above(self.low, number) and below(number, self.high) for number in numbers):  # never true of NaN
            return None
        return f"be in {'(' if self.open_low else '['}{self.low}, {self.high}{')' if self.open_high else ']'}"


@dataclass(frozen=True)
class NotEmpty:
    """At least one value must be given."""

    def broken(self, value: Any) -> str | None:
        """See :data:`Rule`."""
        return None if value else "name at least one"


@dataclass(frozen=True)
class Ending:
    """Allowed endings of a file name; the ending decides the format."""

    endings: tuple[str, ...]

    def broken(self, value: Any) -> str | None:
        """See :data:`Rule`."""
        return None if value.suffix.lower() in self.endings else f"end in {' or '.join(self.endings)}"


Rule: TypeAlias = Within | NotEmpty | Ending
"""Constraint on an argument, given as metadata of its annotation: its method ``broken`` returns None for a valid value,
otherwise the requirement, as the words after "must"."""
T = TypeVar("T")
InFile = Annotated[T, tyro.conf.Fixed, tyro.conf.Suppress]
"""Type of an argument that Python and ``run.json`` can set, and the command line cannot."""
Count: TypeAlias = Annotated[int, Within(1, 10**8)]
"""Positive number of things."""
CountOrNone: TypeAlias = Annotated[int, Within(0, 10**8)]
"""Number of things, possibly zero."""
Jobs: TypeAlias = Annotated[int, Within(1, 4096)]
"""Number of processes or threads."""
Seed: TypeAlias = Annotated[int, Within(0, 2**32 - 1)]
"""Random seed, 32 bits."""
Pixels: TypeAlias = Annotated[int, Within(1, 4096)]
"""Edge length of an image [pixels]."""
ABOVE_ZERO = Within(0.0, math.inf, open_low=True, open_high=True)
"""Rule of positive finite numbers."""
Positive: TypeAlias = Annotated[float, ABOVE_ZERO]
"""Positive finite number."""
NotNegative: TypeAlias = Annotated[float, Within(0.0, math.inf, open_high=True)]
"""Non-negative finite number."""
Share: TypeAlias = Annotated[float, Within(0.0, 1.0, open_low=True)]
"""Fraction in (0, 1]."""
Picture: TypeAlias = Annotated[Path, Ending((".png", ".svg", ".pdf", ".jpg"))]
"""File name of a figure."""
"""File name of JSON results."""


def check_value(flag: str, value: Any, kind: Any) -> None:
    """Check a value, whose flag the message names, against the rules of an annotation; raises BadArgument."""
    for rule in _metadata(kind):
        if isinstance(rule, Rule) and value is not None and (must := rule.broken(value)) is not None:
            words = (" ".join(map(str, value)) or "none") if isinstance(value, tuple) else value
            raise BadArgument(f"{flag} must {must}, got {words}")


def check_arguments(command: Any, prefix: str = "--") -> None:
    """Check all arguments of a command, nested groups included, against their annotations; raises BadArgument."""
    for flag, value, kind in arguments(command, prefix):
        check_value(flag, value, kind)


def require_types(command: Any, prefix: str = "--") -> None:
    """Check the types of all arguments of a command, which a file does not ensure; raises BadArgument."""
    annotations = get_type_hints(type(command))
    for field in fields(command):
        value, kind = getattr(command, field.name), annotations[field.name]
        if not _fits(value, kind):
            flag = prefix + field.name.replace("_", "-")
            raise BadArgument(f"{flag} must be {getattr(kind, '__name__', kind)}, got {value!r:.80}")
        if is_dataclass(value):
            require_types(value, prefix)


def _fits(value: Any, annotation: Any) -> bool:
    """Whether a value has the type of an annotation."""
    parts = get_args(annotation)
    if get_origin(annotation) is Literal:
        return value in parts
    if get_origin(annotation) is tuple:
        return isinstance(value, tuple) and all(_fits(one, parts[0]) for one in value)
    if parts:  # of a union
        return any(_fits(value, part) for part in parts)
    if annotation in (int, float):
        return isinstance(value, (int, annotation)) and not isinstance(value, bool) and abs(value) < 2**1023
    return isinstance(value, annotation)


def arguments(command: Any, prefix: str = "--") -> Iterator[tuple[str, Any, Any]]:
    """Yield flag, value and annotation of every argument of a command, nested groups included."""
    annotations = get_type_hints(type(command), include_extras=True)
    for field in fields(command):
        value, kind = getattr(command, field.name), annotations[field.name]
        flag = prefix + field.name.replace("_", "-")
        if is_dataclass(value):
            metadata = _metadata(kind)
            unnamed = any(one is tyro.conf.OmitArgPrefixes or getattr(one, "name", None) == "" for one in metadata)
            yield from arguments(value, prefix if unnamed else f"{flag}.")
        else:
            yield flag, value, kind


def one_of(names: Iterable[str]) -> tyro.constructors.PrimitiveConstructorSpec[str | None]:
    """How an argument with the default None is read that takes one of some names; None is not offered as one."""
    known = tuple(names)
    metavar = f"{{{','.join(known)}}}"
    return tyro.constructors.PrimitiveConstructorSpec(
        1, metavar, lambda words: words[0], lambda value: value in (None, *known), lambda value: [str(value)], known
    )


def _metadata(annotation: Any) -> Iterator[Any]:
    """All metadata in an annotation and in its type arguments."""
    if get_origin(annotation) is Annotated:
        yield from annotation.__metadata__
    for part in get_args(annotation):
        yield from _metadata(part)


class FileNamesCode(ActiveTouchError, ValueError):
    """A file names code that the command line does not name."""


@dataclass(frozen=True)
class Trust:
    """Code that a file may name: what is ``known`` from the command line, and ``everything`` with ``--trust``."""

    source: Path
    known: Collection[str] = ()
    everything: bool = False

    def allows(self, name: str) -> bool:
        """Whether a name is of a registry, or of code that may be used.

        >>> trust = Trust(Path("run.json"))
        >>> trust.allows("mine:scene(force=2)"), trust.allows("information_gain(given='a:b')")
        (False, True)
        """
        return self.everything or name in self.known or ":" not in name.partition("(")[0]

    def require(self, names: Iterable[str | None]) -> None:
        """Check the names of scenes, renderers or deciders that the file holds."""
        unknown = [str(name) for name in names if name and not self.allows(str(name))]  # a file may hold other types
        if unknown:
            raise FileNamesCode(
                f"{self.source} names code: {', '.join(dict.fromkeys(unknown))}. Reading a file runs no code that only "
                "the file names. If you know where it is from, add --trust"
            )
