"""Sizes of meshes that are allowed, and advice about the units that give one."""

from __future__ import annotations

import math

from belief.errors import InvalidArgument

_SMALLEST, _LARGEST = 0.0005, 0.3  # radius of the bounding ball [m]; objects may be much larger than the pad
_ORDINARY = (0.005, 0.15)  # radii for which an error message gives the command line [m]
_USUAL = (0.002, 0.15)  # radii that are read without a remark [m]
_UNLIKE = 10.0  # factor between a radius and that of most others
_UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254, "metres": 1.0}


def size_problem(name: str, radius: float, scale: float) -> str | None:
    """Why the radius of a mesh, read with a scale, is not allowed, with the units that fit; None if it is."""
    if (problem := _beyond(radius)) is None:
        return None
    usual = [each for each in _UNITS.values() if _ORDINARY[0] <= radius / scale * each <= _ORDINARY[1]]
    example = next(iter(usual), "SCALE")
    return (
        f"{problem}. Give its scale: {units_that_fit(radius / scale)}; that is {name}@{example} "
        f"on the command line, activetouch.read_meshes(path, scale={example}) in Python"
    )


def require_size(label: str, radius: float) -> None:
    """Check the radius of a solid that is touched; the error says in which unit it would be allowed."""
    if problem := _beyond(radius):
        units = f": {units_that_fit(radius)}" * (1e-9 < radius < 1e9)
        raise InvalidArgument(f"the shape {label!r}: {problem}{units}")


def _beyond(radius: float) -> str | None:
    if _SMALLEST <= radius <= _LARGEST:
        return None
    allowed = f"allowed are {_SMALLEST} m to {_LARGEST} m"
    return f"its farthest point is {radius:.4g} m from its origin, {allowed}. Lengths are in metres"


def odd_size(radius: float) -> str | None:
    """A remark on an object in metres that is allowed and unusually small or large; None for others."""
    if _USUAL[0] <= radius <= _USUAL[1] or not _SMALLEST <= radius <= _LARGEST:
        return None
    return (
        f"read in metres, its farthest point is {1e3 * radius:.3g} mm from its middle, which is unusual; give "
        f"its scale to confirm or to change it: {units_that_fit(radius)}"
    )


def unlike_others(radius: float, usual: float, scale: float) -> str | None:
    """A remark on a body, read with a scale, that would be as large as most others in another unit; None for others.

    >>> unlike_others(0.25, 0.025, 0.01).partition(": ")[2]
    'is it in another unit? Read with @0.001, it would have 25 mm'
    """
    others = [radius / scale * unit for unit in _UNITS.values()]
    size, fits = min(zip(others, _UNITS.values(), strict=True), key=lambda each: _apart(each[0], usual))
    if _apart(radius, usual) < _UNLIKE or _apart(size, usual) > math.sqrt(_UNLIKE):
        return None
    lengths = f"its farthest point is {1e3 * radius:.3g} mm from its middle, that of most others {1e3 * usual:.3g} mm"
    return f"{lengths}: is it in another unit? Read with @{fits:g}, it would have {1e3 * size:.3g} mm"


def _apart(one: float, other: float) -> float:
    """The factor between two lengths, at least 1."""
    return round(max(one / other, other / one), 6)


def units_that_fit(radius: float) -> str:
    """The scales of the usual units in which a radius, in the unit of its file, is allowed.

    >>> units_that_fit(20.0)
    '0.001 if it is in millimetres, or 0.01 if it is in centimetres'
    """
    fitting = [(unit, scale) for unit, scale in _UNITS.items() if _SMALLEST <= radius * scale <= _LARGEST]
    if not fitting:
        return f"no usual unit fits, but {_SMALLEST / radius:.2g} to {_LARGEST / radius:.2g} would"
    return ", or ".join(f"{scale:g} if it is in {unit}" for unit, scale in fitting)
