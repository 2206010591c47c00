"""Constraints as data: an annotation states what a value must be, for options, constructors and files alike.

>>> @dataclass(frozen=True)
... class Rule:
...     confirm: Probability = 0.9
...     touches: Count = 3
...
...     def __post_init__(self) -> None:
...         check(self)
>>> Rule(confirm=1.5)
Traceback (most recent call last):
...
belief.errors.InvalidArgument: confirm must be a number in [0, 1], got 1.5
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, Union, get_args, get_origin, get_type_hints

from belief.errors import InvalidArgument
from belief.naming import shown

MOST_COUNT = 2**53
"""Largest count: integers up to here are exact floats."""


@dataclass(frozen=True)
class Within:
    """Range of a number, of an integer if ``low`` is one; ``open_low`` and ``open_high`` exclude the ends.

    ``unit``, as in " rad", is for the message.
    """

    low: float
    high: float
    open_low: bool = False
    open_high: bool = False
    unit: str = ""

    def broken(self, value: Any) -> str | None:
        """See :data:`Rule`."""
        is_whole = type(self.low) is int
        is_number = type(value) is (int if is_whole else float) or _is_number(value, is_whole)
        above = is_number and (self.low < value if self.open_low else self.low <= value)  # never true of NaN
        if above and (value < self.high if self.open_high else value <= self.high):
            return None
        if is_whole:
            return f"be an integer, at least {self.low}" + f" and at most {self.high}" * bool(above)
        if self.low == -math.inf:
            return "be a finite number"
        if self.high == math.inf:
            return f"be a {'finite ' * self.open_high}number {'>' if self.open_low else '≥'} {self.low:g}"
        ends = "(" if self.open_low else "[", ")" if self.open_high else "]"
        return f"be a number in {ends[0]}{self.low:g}, {self.high:g}{ends[1]}{self.unit}"


def _is_number(value: Any, is_whole: bool) -> bool:
    """Whether a value is an integer, or a real number that floats reach."""
    if isinstance(value, bool) or not isinstance(value, Integral if is_whole else Real):
        return False
    try:
        return is_whole or not math.isnan(value)
    except OverflowError:
        return False


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


@dataclass(frozen=True)
class Choice:
    """A value of several; an annotation says it by ``Literal``."""

    values: tuple[Any, ...]

    def broken(self, value: Any) -> str | None:
        """See :data:`Rule`."""
        return None if value in self.values else f"be one of {', '.join(map(str, self.values))}"


Rule: TypeAlias = Within | NotEmpty | Ending | Choice
"""Constraint on a value, as metadata of its annotation: its method ``broken`` returns None for a valid value, otherwise
the requirement, as the words after "must"."""
ABOVE_ZERO = Within(0.0, math.inf, open_low=True, open_high=True)
NOT_NEGATIVE = Within(0.0, math.inf, open_high=True)
FINITE = Within(-math.inf, math.inf, open_low=True, open_high=True)
FRACTION = Within(0.0, 1.0, open_low=True, open_high=True)
SHARE = Within(0.0, 1.0, open_low=True)
BELOW_ONE = Within(0.0, 1.0, open_high=True)
# Types with a rule; a count of none is zero, a fraction is in (0, 1), a share in (0, 1], a probability in [0, 1].
Count: TypeAlias = Annotated[int, Within(1, MOST_COUNT)]
CountOrNone: TypeAlias = Annotated[int, Within(0, MOST_COUNT)]
Positive: TypeAlias = Annotated[float, ABOVE_ZERO]
NotNegative: TypeAlias = Annotated[float, NOT_NEGATIVE]
Finite: TypeAlias = Annotated[float, FINITE]
Fraction: TypeAlias = Annotated[float, FRACTION]
Share: TypeAlias = Annotated[float, SHARE]
Probability: TypeAlias = Annotated[float, Within(0.0, 1.0)]


def require_rule(name: str, value: Any, rule: Rule, error: type[Exception] = InvalidArgument) -> None:
    """Raise the error for a value that breaks a rule; it has the name, what was given, and what would work."""
    if (must := rule.broken(value)) is not None:
        given = value if isinstance(value, Path) else "none" if isinstance(value, tuple) and not value else shown(value)
        raise error(f"{name} must {must}{';' if isinstance(rule, Choice) else ','} got {given}")


class Constraint(NamedTuple):
    """The rules of an annotation: of a value or, in a tuple, of each of several; None may be a value as well.

    ``length`` is that of such a tuple, 0 for any.
    """

    rules: tuple[Rule, ...]
    is_optional: bool
    may_be_tuple: bool
    may_be_one: bool
    length: int

    @classmethod
    def of(cls, annotation: Any) -> Constraint:
        """The constraint that an annotation states."""
        parts = list(_parts(annotation))
        choices = [get_args(part) for part in parts if get_origin(part) is Literal and str not in parts]
        rules = *(part for part in parts if isinstance(part, Rule)), *map(Choice, choices)
        origins = [get_origin(part) for part in parts]
        is_union = any(origin in (Union, UnionType) for origin in origins)
        of_tuple = next((get_args(part) for part in parts if get_origin(part) is tuple), (Ellipsis,))
        length = 0 if Ellipsis in of_tuple else len(of_tuple)
        return cls(rules, NoneType in parts, tuple in origins, tuple not in origins or is_union, length)

    def require(self, name: str, value: Any, error: type[Exception] = InvalidArgument) -> None:
        """Raise the error of :func:`require_rule` for a value, or for one of a tuple, that breaks a rule."""
        if value is None and self.is_optional:
            return
        several = self.may_be_tuple and isinstance(value, tuple | list)
        if not (several or self.may_be_one):
            raise error(f"{name} must be a tuple, got {shown(value)}")
        if several and self.length and len(value) != self.length:
            raise error(f"{name} must be {self.length} values, got {shown(value)}")
        for rule in self.rules:
            for one in value if several and not isinstance(rule, NotEmpty) else (value,):
                require_rule(name, one, rule, error)


def check(value: Any, error: type[Exception] = InvalidArgument) -> None:
    """Raise the error for the first field of a dataclass that breaks a rule of its annotation."""
    for name, constraint in _constraints(type(value)):  # type: ignore[arg-type]
        constraint.require(name, getattr(value, name), error)


class Checked:
    """Base of dataclasses whose constructor checks the rules of their annotations and nothing else."""

    def __post_init__(self) -> None:
        check(self)


@cache
def _constraints(kind: Any) -> tuple[tuple[str, Constraint], ...]:
    """The fields of a class that have rules."""
    hints = get_type_hints(kind, include_extras=True)
    found = ((field.name, Constraint.of(hints[field.name])) for field in fields(kind))
    return tuple((name, constraint) for name, constraint in found if constraint.rules)


def _parts(annotation: Any) -> Iterator[Any]:
    """An annotation, its metadata and its type arguments, at any depth."""
    yield annotation
    if get_origin(annotation) is not Literal:
        for part in get_args(annotation):
            yield from _parts(part)
