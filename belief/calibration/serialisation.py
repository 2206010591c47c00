"""Calibrations as JSON text with their class and shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Protocol, TypeVar

from belief.files import sealed_json, unsealed_json


class Writable(Protocol):
    """A calibration that can be written to a file."""

    name: ClassVar[str]

    @property
    def num_shapes(self) -> int | None:
        """K; None if it is valid for any number."""

    def to_fields(self) -> dict[str, Any]:
        """All parameters, as JSON types."""


W = TypeVar("W", bound=Writable)


def write_json(calibration: Writable, shape_labels: Sequence[str]) -> str:
    """JSON text for :func:`read_json`, exact and with a SHA-256.

    >>> from belief.calibration import TemperatureScaling
    >>> write_json(TemperatureScaling(), ["cube", "cone"]).split()[:3]
    ['{', '"calibration":', '"temperature",']
    """
    if calibration.num_shapes not in (None, len(shape_labels)):
        raise ValueError(f"fitted for {calibration.num_shapes} shapes, got the names {list(shape_labels)}")
    fields = {"calibration": calibration.name, "shape_labels": list(shape_labels), **calibration.to_fields()}
    return sealed_json(fields)


def read_json(text: str, builders: Mapping[str, Callable[[Mapping[str, Any]], W]], shape_labels: Sequence[str]) -> W:
    """The calibration in a text, from the builder for its name.

    Raises:
        ValueError: the text is not such a calibration, was changed, or is for other shapes or another order.

    >>> read_json("[]", {}, ["cube"])
    Traceback (most recent call last):
    ...
    ValueError: not the calibration that was asked for: it is list, not a JSON object
    """
    try:
        fields = unsealed_json(text)
        if fields["calibration"] not in builders:
            raise ValueError(f"expected {' or '.join(builders)}, found {fields['calibration']!r}")
        if list(fields["shape_labels"]) != list(shape_labels):
            raise ValueError(f"it is for the shapes {fields['shape_labels']}, not for {list(shape_labels)}")
        calibration = builders[fields["calibration"]](fields)
        if calibration.num_shapes not in (None, len(shape_labels)):
            raise ValueError(f"it has parameters for {calibration.num_shapes} shapes, and names {len(shape_labels)}")
    except ValueError as error:
        raise ValueError(f"not the calibration that was asked for: {error}") from error
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f"not a calibration: {error!r}") from error
    return calibration
