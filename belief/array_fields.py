"""Arrays as JSON types: little-endian numbers in half or single precision, in base64.

>>> field = to_field(np.array([[1.0, 0.5]]), "float16")
>>> field
{'shape': (1, 2), 'float16': 'ADwAOA=='}
>>> from_field(field, "float16").tolist()
[[1.0, 0.5]]
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import numpy as np

from belief.problem import Floats

Precision: TypeAlias = Literal["float16", "float32"]


def to_field(array: Floats, precision: Precision) -> dict[str, Any]:
    """The shape of an array, and its numbers as text under the name of the precision."""
    numbers = np.asarray(array, np.dtype(precision).newbyteorder("<"))
    return {"shape": array.shape, precision: base64.b64encode(numbers.tobytes()).decode("ascii")}


def from_field(field: Mapping[str, Any], precision: Precision) -> Floats:
    """The array of :func:`to_field`, in double precision."""
    shape = tuple(int(n) for n in field["shape"])
    numbers = np.frombuffer(base64.b64decode(field[precision]), np.dtype(precision).newbyteorder("<"))
    return numbers.reshape(shape).astype(np.float64)
