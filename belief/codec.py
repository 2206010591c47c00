"""One codec: dataclasses as JSON types and back, by the annotations of their fields; and arrays, exact or rounded.

:func:`to_fields` writes an object. :func:`from_fields` checks each value against the annotation of its field, at any
depth, and calls the constructor, which checks the rest. No name in a file selects code. What an annotation cannot say
by its type, it says by a mark:

>>> from typing import Annotated
>>> @dataclass(frozen=True)
... class Reading:
...     label: Literal["cube", "cone"]
...     numbers: Annotated[NDArray[np.float64], Stored("float16")]
...     poses: Annotated[tuple[int, ...], OPTIONAL] = ()
>>> fields = to_fields(Reading("cube", np.array([1.0, 0.1])))
>>> fields
{'label': 'cube', 'numbers': {'shape': [2], 'float16': 'ADxmLg=='}}
>>> from_fields(Reading, fields).numbers.round(4).tolist()
[1.0, 0.1]
>>> from_fields(Reading, fields | {"poses": [0, "z90"]})
Traceback (most recent call last):
...
belief.errors.InvalidArgument: poses[1] must be int, got 'z90'
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from belief.errors import InvalidArgument
from belief.naming import shown
from belief.validation import are_finite

Precision: TypeAlias = Literal["float16", "float32"]
T = TypeVar("T")
_MOST_NUMBERS, _MOST_AXES = 1 << 24, 4  # of an array


@dataclass(frozen=True)
class Stored:
    """Mark of an array that a file rounds to half or single precision: in base64, or as lists of shortest decimals."""

    precision: Precision
    is_decimal: bool = False


@dataclass(frozen=True)
class Merged:
    """Mark of an object whose fields stand among those of its owner, with a prefix before their names."""

    prefix: str = ""


@dataclass(frozen=True)
class OneOf:
    """Mark of an object of one of several classes, by the ``name`` that is its first field."""

    classes: Mapping[str, type]


OPTIONAL, INFINITE = "optional", "infinite"
"""Marks of a field that is left out where it has its default, and of numbers that may be infinite: null in a file."""


class _Field(NamedTuple):
    name: str
    kind: Any  # with all its marks
    marks: tuple[Any, ...]
    default: Any  # MISSING if there is none

    def mark(self, kind: type[T]) -> T | None:
        return next((mark for mark in self.marks if isinstance(mark, kind)), None)


@cache
def _fields_of(kind: Any) -> tuple[_Field, ...]:
    """The fields of a dataclass or named tuple, in the order of its files: ``last_in_file`` names those at the end."""
    hints = get_type_hints(kind, include_extras=True)
    if is_dataclass(kind):
        defaults = {f.name: f.default if f.default_factory is MISSING else None for f in fields(kind) if f.init}
    else:
        defaults = {name: kind._field_defaults.get(name, MISSING) for name in kind._fields}
    last = getattr(kind, "last_in_file", ())
    names = sorted(defaults, key=lambda name: last.index(name) if name in last else -1)
    return tuple(_Field(name, hints[name], getattr(hints[name], "__metadata__", ()), defaults[name]) for name in names)


def to_fields(value: Any, kind: type | None = None) -> dict[str, Any]:
    """The fields of a dataclass or named tuple as JSON types; of ``kind`` alone, if it is a base class."""
    found: dict[str, Any] = {}
    for field in _fields_of(kind or type(value)):
        part = getattr(value, field.name)
        if merged := field.mark(Merged):
            found |= {merged.prefix + name: one for name, one in to_fields(part).items()}
        elif not (OPTIONAL in field.marks and part == field.default):
            found[field.name] = _written(part, field)
    return found


def _names(field: _Field) -> list[str]:
    """The names that a field has in files."""
    merged = field.mark(Merged)
    return [merged.prefix + one.name for one in _fields_of(get_args(field.kind)[0])] if merged else [field.name]


def _written(value: Any, field: _Field) -> Any:
    if isinstance(value, np.ndarray):
        if (stored := field.mark(Stored)) is None:
            return (value.astype(int) if value.dtype == bool else value).tolist()
        if not stored.is_decimal:
            return array_field(value, stored.precision)
        decimals = [float(str(number)) for number in value.astype(stored.precision).ravel()]
        return np.array(decimals).reshape(value.shape).tolist()
    if isinstance(value, Enum | Path):
        return value.value if isinstance(value, Enum) else str(value)
    if is_dataclass(value) or hasattr(value, "_fields"):
        return ({"name": getattr(value, "name")} if field.mark(OneOf) else {}) | to_fields(value)  # noqa: B009
    if isinstance(value, Mapping):
        return {name: _written(part, field) for name, part in value.items()}
    if value == math.inf and INFINITE in field.marks:
        return None
    if isinstance(value, tuple | list):
        return [_written(part, field) for part in value]
    return value


def from_fields(kind: type[T], fields: Mapping[str, Any], *, is_whole: bool = True) -> T:
    """The object of fields from :func:`to_fields`, without others if it ``is_whole``; absent ones have defaults."""
    if not isinstance(fields, Mapping):
        raise InvalidArgument(f"{kind.__name__} must be a JSON object, got {shown(fields)}")
    values, known = {}, _fields_of(kind)  # type: ignore[arg-type]
    if is_whole and (unknown := fields.keys() - {name for field in known for name in _names(field)}):
        raise InvalidArgument(f"{kind.__name__} has no field {min(unknown)!r}")
    for field in known:
        if merged := field.mark(Merged):
            own = {name.removeprefix(merged.prefix): fields[name] for name in _names(field) if name in fields}
            values[field.name] = from_fields(get_args(field.kind)[0], own)
        elif field.name in fields:
            values[field.name] = _read(field.name, fields[field.name], field.kind)
        elif field.default is MISSING:
            raise InvalidArgument(f"the field {field.name!r} of {kind.__name__} is missing")
    return kind(**values)


def _read(name: str, value: Any, kind: Any, marks: tuple[Any, ...] = ()) -> Any:
    """A value of the type that an annotation names; the error has the name, with the place in it."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _read(name, value, parts[0], kind.__metadata__)
    if origin in (Union, UnionType):
        return _read_one(name, value, parts, marks)
    if value is None and kind is float and INFINITE in marks:
        return math.inf
    if kind in (int, float):  # not a bool, nor a number that is not finite
        if isinstance(value, int | kind) and not isinstance(value, bool) and are_finite(value):
            return value
    elif origin is Literal:
        if any(value == part and type(value) is type(part) for part in parts):
            return value
        raise InvalidArgument(f"{name} must be one of {', '.join(map(str, parts))}; got {shown(value)}")
    elif origin is tuple and isinstance(value, list | tuple):
        if parts[-1] is Ellipsis and _are_plain(value, parts[0]):
            return tuple(value)
        kinds = [parts[0]] * len(value) if parts[-1] is Ellipsis else parts
        if len(kinds) == len(value):
            return tuple(_read(f"{name}[{i}]", *pair, marks) for i, pair in enumerate(zip(value, kinds, strict=True)))
    elif np.ndarray in (kind, origin):
        return _read_array(name, value, np.dtype(get_args(parts[1])[0]), marks)
    elif isinstance(origin, type) and issubclass(origin, Mapping) and isinstance(value, Mapping):
        return {key: _read(f"{name}.{key}", part, parts[1], marks) for key, part in value.items()}
    elif kind is Any or (origin is None and isinstance(value, kind)):
        return value
    elif choice := next((mark for mark in marks if isinstance(mark, OneOf)), None):
        given = value.get("name") if isinstance(value, Mapping) else value
        if not isinstance(given, str) or given not in choice.classes:
            raise InvalidArgument(f"unknown {name} {shown(given)}, known are {', '.join(choice.classes)}")
        return from_fields(choice.classes[given], {key: value[key] for key in value if key != "name"})
    elif is_dataclass(kind) or hasattr(kind, "_fields"):
        return from_fields(kind, value)
    elif isinstance(kind, type) and (issubclass(kind, Enum) or (issubclass(kind, Path) and isinstance(value, str))):
        return kind(value)
    raise InvalidArgument(f"{name} must be {getattr(kind, '__name__', kind)}, got {shown(value)}")


def _are_plain(values: list[Any] | tuple[Any, ...], kind: Any) -> bool:
    """Whether each value is a text or a finite number of the type or union ``kind``, so that none is read by itself."""
    kinds = get_args(kind) or (kind,)
    if not all(one in (int, float, str) for one in kinds):
        return False
    allowed = {*kinds, int} if float in kinds else set(kinds)
    return allowed.issuperset(map(type, values)) and are_finite(*(one for one in values if type(one) is not str))


def _read_one(name: str, value: Any, kinds: tuple[Any, ...], marks: tuple[Any, ...]) -> Any:
    """A value of the first of several types that it has."""
    if value is None and NoneType in kinds:
        return None
    errors = []
    for kind in (kind for kind in kinds if kind is not NoneType):
        try:
            return _read(name, value, kind, marks)
        except ValueError as error:
            errors.append(str(error))
    raise InvalidArgument("; or ".join(errors))


def _read_array(name: str, value: Any, dtype: np.dtype[Any], marks: tuple[Any, ...]) -> NDArray[Any]:
    """An array of finite numbers, in the precision of its file, then in its type."""
    stored = next((mark for mark in marks if isinstance(mark, Stored)), None)
    try:
        if stored is not None and not stored.is_decimal:
            array = array_from(value, stored.precision)
        else:
            array = np.asarray(value)
            if array.dtype.kind not in "iufb" and array.size:
                raise InvalidArgument(f"{shown(value)} is no array of numbers")
            with np.errstate(over="ignore"):
                array = array.astype(stored.precision if stored else dtype)
    except (TypeError, OverflowError, ValueError) as error:
        raise InvalidArgument(f"{name}: {error}") from error
    if not np.isfinite(array).all():
        raise InvalidArgument(f"{name} holds a number that is not finite")
    return array.astype(dtype)


def array_field(array: NDArray[Any], precision: Precision | None = None) -> dict[str, Any]:
    """An array of numbers as JSON types, exact to the last bit by default, or rounded to a precision."""
    little = np.ascontiguousarray(array, np.dtype(precision or array.dtype).newbyteorder("<"))
    text = base64.b64encode(little.tobytes()).decode("ascii")
    if precision is not None:
        return {"shape": list(array.shape), precision: text}
    return {"dtype": little.dtype.str, "shape": list(array.shape), "base64": text}


def array_from(field: Any, precision: Precision | None = None) -> NDArray[Any]:
    """The array of :func:`array_field`, in double precision if it was rounded; raises InvalidArgument for another."""
    try:
        dtype = np.dtype(precision or str(field["dtype"]))
        shape, text = tuple(int(n) for n in field["shape"]), field[precision or "base64"]
        content = base64.b64decode(text, validate=True)
    except (KeyError, TypeError, ValueError) as error:
        needed = f"shape and {precision}" if precision else "dtype, shape and base64"
        raise InvalidArgument(f"an array needs {needed}: {error}") from error
    if dtype.kind not in "fiu" or len(shape) > _MOST_AXES or math.prod(shape) > _MOST_NUMBERS:
        raise InvalidArgument(f"{dtype} {shape} is no array of numbers, or a larger one than is read")
    array = array_of(content, dtype if precision is None else dtype.newbyteorder("<"), shape)
    return array.astype(np.float64 if precision else dtype.newbyteorder("="))


def array_of(content: bytes | memoryview, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """The array, read-only, that bytes hold; raises InvalidArgument for objects, and for another number of bytes."""
    if dtype.hasobject:
        raise InvalidArgument("Object arrays cannot be read, because that would run code from the file")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(content):
        raise InvalidArgument(f"an array of {len(content)} bytes is said to be {shape} {dtype}")
    return np.frombuffer(content, dtype).reshape(shape)
