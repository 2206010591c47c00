"""The protocol of shapes, and geometry that several solids use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from activetouch.errors import BadMesh
from activetouch.solids.raster import Surface
from activetouch.solids.triangles import Floats as Floats
from activetouch.solids.triangles import Ints as Ints
from activetouch.solids.triangles import on_spiral as on_spiral
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
