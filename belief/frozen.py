"""Read-only arrays in frozen dataclasses, also after pickling and deep copies."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from belief.validation import as_real, require

Kind = TypeVar("Kind", bound=np.generic)
_PRINTED = 8  # numbers of an array


def frozen(array: NDArray[Kind]) -> NDArray[Kind]:
    """A read-only version of an array: the array itself if its memory cannot be written to, otherwise a copy."""
    owner: Any = array
    while isinstance(owner, np.ndarray) and not owner.flags.writeable:
        owner = owner.base
    if not isinstance(owner, np.ndarray):
        return array
    copy = array.copy(order="K")
    copy.flags.writeable = False
    return copy


class FrozenArrays:
    """Base of frozen dataclasses that hold arrays, or tuples of arrays, in their fields.

    A subclass with a ``__post_init__`` of its own calls :meth:`freeze` at its end.
    """

    def __init_subclass__(cls, **named: Any) -> None:
        """Print arrays of many numbers by their shape; a dataclass keeps a ``__repr__`` that its class has."""
        super().__init_subclass__(**named)
        if "__repr__" not in vars(cls):
            cls.__repr__ = FrozenArrays.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        parts = (f"{one.name}={_in_short(getattr(self, one.name))}" for one in fields(self) if one.repr)  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(parts)})"

    def __post_init__(self) -> None:
        self.freeze()

    def to_floats(self, *names: str, finite: bool = True) -> None:
        """Make fields float64 arrays; raises ValueError for masked or NaN entries, and for infinity if ``finite``."""
        for name in names:
            values = np.asarray(as_real(getattr(self, name), name), np.float64)
            valid = np.isfinite(values) if finite else ~np.isnan(values)
            require(valid, values, name, "a number that is not finite" if finite else "NaN")
            object.__setattr__(self, name, values)

    def freeze(self) -> None:
        """Make all arrays read-only; arrays whose memory is writable are copied."""
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, field.name, frozen(value))
            elif isinstance(value, tuple) and any(isinstance(part, np.ndarray) for part in value):
                parts = [frozen(part) if isinstance(part, np.ndarray) else part for part in value]
                object.__setattr__(self, field.name, type(value)(*parts) if hasattr(value, "_fields") else tuple(parts))

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.freeze()


def _in_short(value: Any) -> str:
    """An array of more than eight numbers by its type and shape, anything else as it is printed."""
    if isinstance(value, np.ndarray) and value.size > _PRINTED:
        return f"<{value.dtype} {value.shape}>"
    return repr(value)
