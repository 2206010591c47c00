"""Solids as triangles: boxes, prisms, round bodies, what planes cut off, and unions.

A touch feels triangles; there is no second description of a solid. Flat faces are exact. The triangles of round ones
lie on both sides of the true surface, at most 10 µm from it, which a pad cannot feel. To add a solid, derive from
:class:`Hull` with its corners, or from :class:`Turned` with the rings around its axis.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from functools import lru_cache
from typing import Any, ClassVar, Literal, NamedTuple, cast

import numpy as np
import scipy  # whose parts load at first use

from activetouch.solids.raster import Surface
from activetouch.solids.solid import Geom, Shape, require_lengths
from activetouch.solids.triangles import Floats, Ints, Triangles
from belief.validation import require_count

TOLERANCE = 1e-5
"""Greatest distance between a round surface of a radius up to 0.3 m and its triangles [m]."""

_FINEST, _COARSEST = 1 / 30_000, 1 / 10  # least and greatest such distance of other radii, relative to the radius
_MOST_BODIES = 256  # whose triangles are kept
_MOST_FACETS = 10_000  # of a solid that says its own number
_FACETS = 64  # sides of what stands for a circle in MuJoCo
_DOWN = (1.0, -1.0, 1.0)  # turns rings upside down


def hull(points: Floats) -> Triangles:
    """The convex hull of points ``(n, 3)``."""
    found = scipy.spatial.ConvexHull(points)
    used, faces = np.unique(found.simplices, return_inverse=True)
    vertices, faces = points[used], faces.reshape(-1, 3)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    inwards = (np.cross(b - a, c - a) * found.equations[:, :3]).sum(axis=1) < 0.0
    faces[inwards] = faces[inwards, ::-1]
    return vertices, faces


def joined(parts: Sequence[Triangles]) -> Triangles:
    """The triangles of several bodies."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [part[1] + start for part, start in zip(parts, starts, strict=True)]
    return np.vstack([part[0] for part in parts]), np.vstack(faces)


def turned(rings: Floats, closed: bool = False) -> Triangles:
    """The surface between rings around the z axis, each a regular polygon with its first corner above the x axis.

    Args:
        rings: radius and height [m], and number of corners, ``(n, 3)``, such that outside is on the right of the way
            from one to the next; a ring of radius 0 has one corner.
        closed: whether the last ring is joined to the first. Otherwise, triangles fill the first and the last.

    >>> vertices, faces = turned(np.array([(2, 0, 8), (0, 1, 1)]))  # a pyramid
    >>> vertices.shape, faces.shape
    ((10, 3), (16, 3))
    """
    if not closed:
        rings = np.vstack([*_middle(rings[0]), rings, *_middle(rings[-1])])
    ring, place, counts, starts = _places(rings)
    here, following = starts[ring] + place, starts[ring] + (place + 1) % counts[ring]
    # Each edge is joined to the corner of the next ring, and of the one before, that comes after its middle.
    later, earlier = (ring + 1) % len(rings), (ring - 1) % len(rings)
    number, middle = counts[ring], 2 * place + 1  # in half edges; whole numbers, because halves are rounded both ways
    over = -((number - middle * counts[later]) // (2 * number)) % counts[later]
    under = (middle * counts[earlier] + number) // (2 * number) % counts[earlier]
    up = np.stack([here, following, starts[later] + over], axis=1)
    down = np.stack([following, here, starts[earlier] + under], axis=1)
    faces = np.vstack([up if closed else up[ring < len(rings) - 1], down if closed else down[ring > 0]])
    return corners_of(rings), faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]  # a single corner has no edge


def _places(rings: Floats) -> tuple[Ints, Ints, Ints, Ints]:
    """Ring and place in it of each corner, ``(v,)``; number of corners and first corner of each ring, ``(n,)``."""
    counts = rings[:, 2].astype(np.intp)
    starts, ring = np.cumsum(counts) - counts, np.arange(len(rings)).repeat(counts)
    return ring, np.arange(len(ring)) - starts[ring], counts, starts


def _middle(ring: Floats) -> list[Floats]:
    """The middle of a ring that has more than one corner."""
    return [np.array([0.0, ring[1], 1.0])] if ring[2] > 1 else []


def corners_of(rings: Floats) -> Floats:
    """The corners of rings, in turn; see :func:`turned`."""
    ring, place, *_ = _places(rings)
    radius, height, number = rings[ring].T
    angle = place * (2 * np.pi / number)
    return np.column_stack([np.cos(angle) * radius, np.sin(angle) * radius, height])


def circle(radius: float, facets: int = 0, tolerance: float = TOLERANCE) -> tuple[float, int]:
    """Radius and number of corners of a polygon for a circle.

    Args:
        radius: of the circle [m].
        facets: number of corners on the circle; by default a multiple of four, as few as keep the polygon within the
            tolerance of the circle, on both sides of it.
        tolerance: that distance [m].

    >>> radius, number = circle(0.016)
    >>> round(radius, 6), number
    (0.01601, 64)
    """
    if facets or radius == 0.0:
        return radius, facets if radius else 1
    tolerance = _tolerance(radius, tolerance)
    number = np.pi / np.arccos((radius - tolerance) / (radius + tolerance))
    return radius + tolerance, 4 * int(np.ceil(number / 4))


def _tolerance(radius: float, wanted: float) -> float:
    """The distance that is allowed for a radius."""
    return min(max(wanted, radius * _FINEST), radius * _COARSEST)


def quarter(radius: float, facets: int = 0) -> Floats:
    """Rings from the equator of a ball to its upper pole; see :func:`turned` and :func:`circle`."""
    if facets:
        elevation = np.linspace(0.0, np.pi / 2, facets // 4, endpoint=False)
        number = np.full(len(elevation), facets)
    else:
        tolerance = _tolerance(radius, TOLERANCE)
        radius += tolerance
        widest = np.sqrt(8 * tolerance / radius)  # angle between neighbours, whose quads then reach the lower bound
        elevation = np.linspace(0.0, np.pi / 2, int(np.ceil(np.pi / 2 / widest)), endpoint=False)
        number = 4 * np.ceil(np.pi / 2 / widest * np.cos(elevation))
    rings = np.column_stack([radius * np.cos(elevation), radius * np.sin(elevation), number])
    return np.vstack([rings, [0.0, radius, 1.0]])


class _Body(NamedTuple):
    """What a solid is for a touch and for a simulation."""

    surface: Surface
    bounding_radius: float
    geom: Geom


@lru_cache(maxsize=_MOST_BODIES)
def _body(solid: Solid) -> _Body:
    surface = solid.make_surface()
    return _Body(surface, float(np.linalg.norm(surface.vertices, axis=0).max()), solid.make_geom(surface))


class Solid(ABC):
    """Base of frozen dataclasses whose fields are lengths [m] above zero; see :class:`Shape`.

    Attributes:
        kind: of MuJoCo's geom, whose sizes the fields are; or a mesh.
        presses: see :class:`Geom`.
    """

    kind: ClassVar[str] = "mesh"
    presses: ClassVar[Literal["solid", "surface", "hull"]] = "solid"

    def __post_init__(self) -> None:
        number = 3 if self.kind in ("box", "ellipsoid") else len(fields(cast(Any, self)))
        if len(self._sizes) != number:
            raise ValueError(f"a {self.kind} must have {number} lengths, got {self}")
        require_lengths(self, *self._sizes)

    @property
    def _sizes(self) -> tuple[float, ...]:
        return tuple(np.hstack(astuple(cast(Any, self))).tolist())

    @property
    def surface(self) -> Surface:
        """See :class:`Shape`."""
        return _body(self).surface

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return _body(self).bounding_radius

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return _body(self).geom

    @abstractmethod
    def triangles(self) -> Triangles:
        """The triangles of the surface."""

    def make_surface(self) -> Surface:
        """The triangles, prepared, which :attr:`surface` keeps."""
        return Surface.of(*self.triangles(), is_sound=True)

    def make_geom(self, surface: Surface) -> Geom:
        """The collision geometry, which :attr:`geom` keeps."""
        if self.kind != "mesh":
            return Geom(self.kind, (*self._sizes, 0.0, 0.0)[:3])
        return Geom("mesh", vertices=self.collision_corners(surface), presses=self.presses)

    def collision_corners(self, surface: Surface) -> Floats:
        """Points whose convex hull MuJoCo collides with, ``(n, 3)`` [m]."""
        return surface.vertices.T


class Hull(Solid):
    """The convex hull of its corners."""

    @property
    @abstractmethod
    def corners(self) -> Floats:
        """``(n, 3)`` [m]."""

    def triangles(self) -> Triangles:
        """See :class:`Solid`."""
        return hull(self.corners)


class Turned(Solid):
    """A solid of revolution about its z axis.

    Attributes:
        num_facets: number of sides of the mesh for MuJoCo, which has few such solids.
    """

    num_facets: int = _FACETS

    @abstractmethod
    def rings(self, facets: int = 0) -> Floats:
        """What the solid is the surface between; see :func:`turned` for them and :func:`circle` for ``facets``."""

    def triangles(self) -> Triangles:
        """See :class:`Solid`."""
        return turned(self.rings())

    def collision_corners(self, surface: Surface) -> Floats:
        """See :class:`Solid`."""
        return corners_of(self.rings(self.num_facets))


@dataclass(frozen=True)
class Box(Hull):
    """Cuboid with the given half-extents [m] along its own axes."""

    kind = "box"
    half_extents: tuple[float, float, float]

    @property
    def corners(self) -> Floats:
        """See :class:`Hull`."""
        return np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T * self.half_extents


@dataclass(frozen=True)
class Wedge(Hull):
    """Right-angled triangular prism along its y axis, whose height falls along x; origin at the centroid.

    Attributes:
        length: of the base, along x [m].
        height: of the upright face, along z [m].
        half_width: half the extent along y [m].
    """

    length: float
    height: float
    half_width: float

    @property
    def corners(self) -> Floats:
        """See :class:`Hull`."""
        triangle = np.array([[-1, -1], [2, -1], [-1, 2]]) / 3 * (self.length, self.height)
        return np.array([[x, y, z] for y in (-self.half_width, self.half_width) for x, z in triangle])


@dataclass(frozen=True)
class Frustum(Turned):
    """Truncated circular cone about its z axis, origin at half height.

    Attributes:
        bottom_radius: radius at the bottom [m].
        top_radius: radius at the top, smaller or larger, or 0 [m].
        height: from bottom to top [m].
        num_facets: number of sides of the mesh for MuJoCo, which has no frustum.
    """

    bottom_radius: float
    top_radius: float
    height: float
    num_facets: int = _FACETS

    def __post_init__(self) -> None:
        require_lengths(self, self.bottom_radius, self.height)
        if not 0.0 <= self.top_radius < np.inf:
            raise ValueError(f"top_radius must be finite and ≥ 0, got {self}")
        require_count("num_facets", self.num_facets, 3, _MOST_FACETS)

    def rings(self, facets: int = 0) -> Floats:
        """See :class:`Turned`."""
        ends = (self.bottom_radius, -self.height / 2), (self.top_radius, self.height / 2)
        each = [(circle(radius, facets), height) for radius, height in ends]
        return np.array([(radius, height, number) for (radius, number), height in each])


@dataclass(frozen=True)
class Cone(Turned):
    """Circular cone about its z axis, origin at half height: base ``radius`` at the bottom, ``height`` [m]."""

    radius: float
    height: float
    num_facets: int = _FACETS

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count("num_facets", self.num_facets, 3, _MOST_FACETS)

    def rings(self, facets: int = 0) -> Floats:
        """See :class:`Turned`."""
        return Frustum(self.radius, 0.0, self.height).rings(facets)


@dataclass(frozen=True)
class Cylinder(Turned):
    """Circular cylinder about its z axis: ``radius`` and ``half_length`` [m]."""

    kind = "cylinder"
    radius: float
    half_length: float

    def rings(self, facets: int = 0) -> Floats:
        """See :class:`Turned`."""
        return Frustum(self.radius, self.radius, 2 * self.half_length).rings(facets)


@dataclass(frozen=True)
class Prism(Turned):
    """Regular prism about its z axis: ``num_sides``, ``radius`` of its edges and ``half_length`` [m]."""

    num_sides: int
    radius: float
    half_length: float

    def __post_init__(self) -> None:
        require_count("num_sides", self.num_sides, 3, _MOST_FACETS)
        super().__post_init__()

    def rings(self, facets: int = 0) -> Floats:
        """See :class:`Turned`."""
        return Frustum(self.radius, self.radius, 2 * self.half_length).rings(self.num_sides)


@dataclass(frozen=True)
class Sphere(Turned):
    """Ball of the given ``radius`` [m]."""

    kind = "sphere"
    radius: float

    def rings(self, facets: int = 0) -> Floats:
        """See :class:`Turned`."""
        upper = quarter(self.radius, facets)
        return np.vstack([upper[:0:-1] * _DOWN, upper])


@dataclass(frozen=True)
class Ellipsoid(Turned):
    """Ellipsoid with the given half-axes [m] along its own axes."""

    kind = "ellipsoid"
    half_axes: tuple[float, float, float]

    def rings(self, facets: int = 0) -> Floats:
        """Those of a ball of its longest half-axis. See :class:`Turned`."""
        return Sphere(max(self.half_axes)).rings(facets)

    def triangles(self) -> Triangles:
        """See :class:`Solid`."""
        vertices, faces = super().triangles()
        return vertices * (np.array(self.half_axes) / max(self.half_axes)), faces


@dataclass(frozen=True)
class Capsule(Turned):
    """Cylinder about its z axis with a half ball at both ends: ``radius``, ``half_length`` of the cylinder [m]."""

    kind = "capsule"
    radius: float
    half_length: float

    def rings(self, facets: int = 0) -> Floats:
        """See :class:`Turned`."""
        upper = quarter(self.radius, facets) + np.array([0.0, self.half_length, 0.0])
        return np.vstack([upper[::-1] * _DOWN, upper])


@dataclass(frozen=True)
class Dome(Turned):
    """Half ball of the given ``radius`` [m], flat side down, origin at half height."""

    radius: float
    num_facets: int = _FACETS

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count("num_facets", self.num_facets, 4, _MOST_FACETS)

    def rings(self, facets: int = 0) -> Floats:
        """See :class:`Turned`."""
        return quarter(self.radius, facets) - np.array([0.0, self.radius / 2, 0.0])


@dataclass(frozen=True)
class Torus(Turned):
    """Ring around its z axis: ``ring_radius`` of its centre line, ``tube_radius`` of its cross-section [m].

    MuJoCo collides with its convex hull, so that the results of the scenes with a torus stay: a simulated press on the
    hole meets a flat face.
    """

    presses = "hull"
    ring_radius: float
    tube_radius: float
    num_facets: int = _FACETS

    def __post_init__(self) -> None:
        if not 0.0 < self.tube_radius < self.ring_radius < np.inf:
            raise ValueError(f"tube_radius must be in (0, ring_radius), got {self.tube_radius} and {self.ring_radius}")
        require_count("num_facets", self.num_facets, 4, _MOST_FACETS)

    def rings(self, facets: int = 0) -> Floats:
        """The tube; of the mesh for MuJoCo its outer half, which has the same convex hull. See :class:`Turned`."""
        if facets:
            tube, outer, number, stretch = self.tube_radius, np.linspace(-0.5, 0.5, facets // 4 + 1), facets, 1.0
        else:
            tube, around = circle(self.tube_radius, tolerance=TOLERANCE / 2)
            widest = self.ring_radius + tube
            reach, number = circle(widest, tolerance=TOLERANCE / 2)
            outer, stretch = np.linspace(-1.0, 1.0, around, endpoint=False), reach / widest
        angle = np.pi * outer
        radius, height = self.ring_radius + tube * np.cos(angle), tube * np.sin(angle)
        return np.column_stack([stretch * radius, height, np.full(len(angle), number)])

    def triangles(self) -> Triangles:
        """See :class:`Solid`."""
        return turned(self.rings(), closed=True)


@dataclass(frozen=True)
class Union(Solid):
    """Solids that overlap and share their origin, such as a plate and a boss on it.

    MuJoCo collides with the convex hull of what lies in front of the pad.

    Attributes:
        parts: the solids, at least one.

    Raises:
        ValueError: there is no part.

    >>> cross = Union((Box((3.0, 1.0, 1.0)), Box((1.0, 3.0, 1.0))))
    >>> cross.surface.faces.shape
    (3, 24)
    """

    presses = "surface"
    parts: tuple[Shape, ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise ValueError("a union needs at least one part")

    def triangles(self) -> Triangles:
        """See :class:`Solid`."""
        return joined([(part.surface.vertices.T, part.surface.faces.T) for part in self.parts])

    def make_surface(self) -> Surface:
        """See :class:`Solid`."""
        return Surface.of(*self.triangles(), is_sound=all(part.surface.normals is not None for part in self.parts))

    def collision_corners(self, surface: Surface) -> Floats:
        """See :class:`Solid`."""
        return hull(surface.vertices.T)[0]


@dataclass(frozen=True)
class Cut(Solid):
    """What planes leave of a convex solid, such as a cube without a corner or a shaft with a flat.

    Attributes:
        solid: the convex solid before the cuts.
        planes: an outward normal of any length, and the distance of the plane from the origin [m], of each cut:
            ``(x, y, z, distance)``.

    Raises:
        ValueError: a plane is not four finite numbers with a normal, or cuts the origin off; or the solid is not
            convex, as a torus, a union and some meshes.

    >>> cube = Cut(Box((1.0, 1.0, 1.0)), ((1.0, 1.0, 0.0, 1.0),))  # without one edge
    >>> x, y, z = cube.surface.vertices
    >>> float(x.max()), float((x + y).max().round(9))
    (1.0, 1.414213562)
    """

    solid: Shape
    planes: tuple[tuple[float, float, float, float], ...]

    def __post_init__(self) -> None:
        presses = self.solid.presses if isinstance(self.solid, Solid) else self.solid.geom.presses
        if presses != "solid":
            raise ValueError(f"only convex solids can be cut, got a {type(self.solid).__name__}")
        for plane in self.planes:
            if len(plane) != 4 or not np.isfinite(plane).all() or not any(plane[:3]) or plane[3] <= 0.0:
                raise ValueError(
                    f"a plane is a normal (x, y, z) and a distance above zero, so that the origin stays inside; got "
                    f"{plane}"
                )

    def triangles(self) -> Triangles:
        """See :class:`Solid`."""
        vertices, faces = self.solid.surface.vertices.T, self.solid.surface.faces.T
        for *normal, distance in self.planes:
            above = vertices @ normal / np.linalg.norm(normal) - distance
            start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
            crossed = (above[start] > 0.0) & (above[end] < 0.0)  # each edge is in two triangles, once in each direction
            start, end = start[crossed], end[crossed]
            share = above[start] / (above[start] - above[end])
            new = vertices[start] + share[:, None] * (vertices[end] - vertices[start])
            vertices, faces = hull(np.vstack([vertices[above <= 0.0], new]))
        return vertices, faces
