"""Sizes of meshes that are allowed, and advice about the units that give one."""

from __future__ import annotations

import math

from activetouch.solids.solid import LARGEST, SMALLEST, UNITS, size_beyond, units_that_fit

_ORDINARY = (0.005, 0.15)  # radii for which an error message gives the command line [m]
_USUAL = (0.002, 0.15)  # radii that are read without a remark [m]
_UNLIKE = 10.0  # factor between a radius and that of most others


def size_problem(name: str, radius: float, scale: float) -> str | None:
    """Why the radius of a mesh, read with a scale, is not allowed, with the units that fit; None if it is."""
    if (problem := size_beyond(radius)) is None:
        return None
    usual = [each for each in UNITS.values() if _ORDINARY[0] <= radius / scale * each <= _ORDINARY[1]]
    example = next(iter(usual), "SCALE")
    return (
        f"{problem}. Give its scale: {units_that_fit(radius / scale)}; that is {name}@{example} "
        f"on the command line, activetouch.read_meshes(path, scale={example}) in Python"
    )


def odd_size(radius: float) -> str | None:
    """A remark on an object in metres that is allowed and unusually small or large; None for others."""
    if _USUAL[0] <= radius <= _USUAL[1] or not SMALLEST <= radius <= LARGEST:
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
    others = [radius / scale * unit for unit in UNITS.values()]
    size, fits = min(zip(others, UNITS.values(), strict=True), key=lambda each: _apart(each[0], usual))
    if _apart(radius, usual) < _UNLIKE or _apart(size, usual) > math.sqrt(_UNLIKE):
        return None
    lengths = f"its farthest point is {1e3 * radius:.3g} mm from its middle, that of most others {1e3 * usual:.3g} mm"
    return f"{lengths}: is it in another unit? Read with @{fits:g}, it would have {1e3 * size:.3g} mm"


def _apart(one: float, other: float) -> float:
    """The factor between two lengths, at least 1."""
    return round(max(one / other, other / one), 6)
