"""The protocol of shapes, and geometry that several solids use."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any, ClassVar, Literal, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadMesh
from belief.validation import are_finite

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

FINITE = 1e308
"""Largest number that an argument may be."""
_NUM_FACETS = 64  # sides of the mesh that stands for a cylinder

PARALLEL = 1e-12
"""Sine of the angle below which a ray counts as parallel to a plane."""


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
    def bounding_radius(self) -> float:
        """Radius of a ball around the origin that contains the solid, the smallest one if known [m]."""

    @property
    def geom(self) -> Geom:
        """Collision geometry for MuJoCo."""

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """Distance at which rays enter the solid [m]; ``inf`` for a miss.

        Args:
            origins: ray starts, ``(3, n)`` [m], all outside the solid, object frame.
            direction: unit vector ``(3,)`` of all rays, object frame.

        Returns:
            ``(n,)``, in ``[0, inf]``.
        """


def require_lengths(solid: object, *lengths: float) -> None:
    """Check the lengths of a solid.

    Raises:
        ValueError: a length is not positive and finite.
    """
    if not (are_finite(*lengths) and min(lengths) > 0.0):
        raise ValueError(f"a solid needs finite lengths above zero, got {solid}")


class Sized:
    """Base of solids whose fields are all above zero, most of them lengths [m]."""

    def __post_init__(self) -> None:
        require_lengths(self, *self._sizes)

    @property
    def _sizes(self) -> tuple[float, ...]:
        return tuple(np.hstack(astuple(cast(Any, self))).tolist())


_NUM_SIZES = {"sphere": 1, "cylinder": 2, "capsule": 2, "box": 3, "ellipsoid": 3}


class Primitive(Sized):
    """Base of solids that MuJoCo has: their fields are its sizes of the geom ``_kind``."""

    _kind: ClassVar[str]

    def __post_init__(self) -> None:
        if len(self._sizes) != _NUM_SIZES[self._kind]:
            raise ValueError(f"a {self._kind} must have {_NUM_SIZES[self._kind]} lengths, got {self}")
        super().__post_init__()

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return Geom(self._kind, (*self._sizes, 0.0, 0.0)[:3])


def entered(enter: Floats, leave: Floats) -> Floats:
    """Distances at which rays enter a convex solid, ``inf`` where they leave first, or if it is behind them."""
    return np.where((enter <= leave) & (enter >= 0.0), enter, np.inf)


def clip(enter: Floats, leave: Floats, height: Floats, slope: float) -> None:
    """Intersect the intervals ``[enter, leave]`` of the rays, in place, with the half-space below a plane.

    Applied to every plane of a convex solid, this is the slab method.

    Args:
        enter: distances at which the rays enter, ``(n,)`` [m].
        leave: distances at which they leave, ``(n,)`` [m]; below ``enter`` for a miss.
        height: height of the ray starts above the plane, ``(n,)`` [m].
        slope: height gained per metre of ray, the same for all.
    """
    if slope < -PARALLEL:
        np.maximum(enter, height / -slope, out=enter)
    elif slope > PARALLEL:
        np.minimum(leave, height / -slope, out=leave)
    else:
        leave[height > 0.0] = -np.inf


def between(along: Floats, slope: float, extent: float) -> tuple[Floats, Floats]:
    """Distances at which rays enter and leave the space between two planes at ``extent`` on both sides of the origin.

    Args:
        along: position of the ray starts across the planes, ``(n,)`` [m].
        slope: change of it per metre of ray, the same for all.
        extent: distance of each plane from the origin [m].
    """
    if abs(slope) <= PARALLEL:
        leave = np.where(np.abs(along) <= extent, np.inf, -np.inf)
        return np.full_like(leave, -np.inf), leave
    middle, half_chord = along / -slope, extent / abs(slope)
    enter = middle - half_chord
    middle += half_chord
    return enter, middle


def ring(radius: float, z: float, num_points: int) -> Floats:
    """Corners of a regular polygon around the z axis, the first on the x axis, ``(num_points, 3)`` [m]."""
    angle = np.linspace(0.0, 2 * np.pi, num_points, endpoint=False)
    return np.column_stack([np.cos(angle) * radius, np.sin(angle) * radius, np.full(num_points, z)])


def on_spiral(heights: Floats) -> Floats:
    """Unit vectors of these heights along z, turned by the golden angle from one to the next, ``(n, 3)``."""
    angle, radius = np.pi * (1.0 + np.sqrt(5.0)) * (np.arange(len(heights)) + 0.5), np.sqrt(1.0 - heights**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heights])


def frame_across(direction: Floats) -> Floats:
    """Unit vectors x and y that form a right-handed frame with z = −direction, ``(2, 3)``."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(x, direction)])


def corners(geom: Geom) -> Floats:
    """Points whose convex hull stands for a geom.

    Raises:
        ValueError: it is neither a box, nor a cylinder, nor a mesh.
    """
    if geom.vertices is not None:
        return geom.vertices
    if geom.type == "box":
        return np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T * geom.size
    if geom.type == "cylinder":
        radius, half_length = geom.size[:2]
        return np.vstack([ring(radius, z, _NUM_FACETS) for z in (-half_length, half_length)])
    raise ValueError(f"only boxes, cylinders and polyhedra can be cut or joined, got a {geom.type}")


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
