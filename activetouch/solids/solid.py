"""The protocol of shapes, and geometry that several solids use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from activetouch.errors import BadMesh
from activetouch.solids.raster import Surface
from activetouch.solids.triangles import Floats as Floats
from activetouch.solids.triangles import Ints as Ints
from activetouch.solids.triangles import on_spiral as on_spiral
from belief.errors import InvalidArgument
from belief.validation import are_finite

FINITE = 1e308
"""Largest number that an argument may be."""


@dataclass(frozen=True)
class Geom:
    """Collision geometry for MuJoCo: the ``size`` of a primitive [m] or the ``vertices`` ``(n, 3)`` of a mesh [m].

    MuJoCo collides with the convex hull of a mesh; the touch image shows the true surface. ``presses`` says what a
    simulated press meets: ``"solid"``, this geom is the solid; ``"surface"``, the solid is hollow, and what lies in
    front of the pad stands for it (:mod:`activetouch.pressing.dynamic`); ``"hull"``, the solid is hollow, and the hull
    stands for it.
    """

    type: str
    size: tuple[float, ...] = ()
    vertices: Floats | None = None
    presses: Literal["solid", "surface", "hull"] = "solid"


class Shape(Protocol):
    """A solid around its origin.

    Shapes are keys of caches, so equal shapes must have equal hashes. Their ``repr`` is part of the identity of a run.
    """

    def __hash__(self) -> int: ...

    @property
    def surface(self) -> Surface:
        """Its triangles, which a touch feels."""

    @property
    def bounding_radius(self) -> float:
        """Radius of a ball around the origin that contains the solid, the smallest one if known [m]."""

    @property
    def geom(self) -> Geom:
        """Collision geometry for MuJoCo."""


def require_lengths(solid: object, *lengths: float) -> None:
    """Check the lengths of a solid.

    Raises:
        ValueError: a length is no number above zero with which lengths can be compared.
    """
    if not (are_finite(*lengths) and min(lengths) >= 1e-9 and max(lengths) <= 1e9):
        raise ValueError(f"a solid needs finite lengths above zero, in [1e-9, 1e9] m, got {solid}")


SMALLEST, LARGEST = 0.0005, 0.3
"""Radius of the bounding ball of an object [m]; objects may be much larger than the pad."""
UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254, "metres": 1.0}
"""The usual units of files [m]."""


def require_size(label: str, radius: float) -> None:
    """Check the radius of a solid that is touched; the error says in which unit it would be allowed."""
    if problem := size_beyond(radius):
        units = f": {units_that_fit(radius)}" * (1e-9 < radius < 1e9)
        raise InvalidArgument(f"the shape {label!r}: {problem}{units}")


def size_beyond(radius: float) -> str | None:
    """Why a radius is not allowed; None if it is."""
    if SMALLEST <= radius <= LARGEST:
        return None
    allowed = f"allowed are {SMALLEST} m to {LARGEST} m"
    return f"its farthest point is {radius:.4g} m from its origin, {allowed}. Lengths are in metres"


def units_that_fit(radius: float) -> str:
    """The scales of the usual units in which a radius, in the unit of its file, is allowed.

    >>> units_that_fit(20.0)
    '0.001 if it is in millimetres, or 0.01 if it is in centimetres'
    """
    fitting = [(unit, scale) for unit, scale in UNITS.items() if SMALLEST <= radius * scale <= LARGEST]
    if not fitting:
        return f"no usual unit fits, but {SMALLEST / radius:.2g} to {LARGEST / radius:.2g} would"
    return ", or ".join(f"{scale:g} if it is in {unit}" for unit, scale in fitting)


def require_hash(label: str, solid: Shape) -> None:
    """Check that a shape has a hash.

    Raises:
        BadMesh: it has none.
    """
    try:
        hash(solid)
    except TypeError as error:
        raise BadMesh(
            f"the shape {label!r} has no hash ({error}), and a press in MuJoCo finds its model by it; make "
            f"{type(solid).__name__} a frozen dataclass of numbers and tuples"
        ) from error
