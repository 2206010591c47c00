"""Convex solids with flat faces: box, wedge and prism; solids with parts cut off by planes; and unions of solids."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # whose parts load at first use

from activetouch.solids.mesh import Mesh
from activetouch.solids.round import Torus
from activetouch.solids.solid import Floats, Geom, Primitive, Shape, Sized, between, clip, corners, entered, ring
from belief.validation import require_count


class FlatFaced(Sized, ABC):
    """The convex hull of its corners."""

    @property
    @abstractmethod
    def corners(self) -> Floats:
        """Corners of the solid, ``(n, 3)`` [m]."""

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """Unit outward normals of the faces, ``(m, 3)``, and their distances from the origin, ``(m,)`` [m]."""
        facets = scipy.spatial.ConvexHull(self.corners).equations  # triangles; a face can have several
        _, first = np.unique(np.round(facets, 9), axis=0, return_index=True)
        return facets[first, :3], -facets[first, 3]

    @cached_property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.linalg.norm(self.corners, axis=1).max())

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return Geom("mesh", vertices=self.corners)

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        return entered(*crossings(*self.planes, origins, direction))


def crossings(normals: Floats, offsets: Floats, origins: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Distances at which rays enter and leave the intersection of half-spaces, ``(n,)`` each; a miss leaves first.

    Args:
        normals: unit outward normals of the faces, ``(m, 3)``.
        offsets: distances of the faces from the origin, ``(m,)`` [m].
        origins: ray starts, ``(3, n)`` [m].
        direction: unit vector ``(3,)`` of all rays.
    """
    enter, leave = np.full(origins.shape[1], -np.inf), np.full(origins.shape[1], np.inf)
    for normal, offset in zip(normals, offsets, strict=True):
        clip(enter, leave, normal @ origins - offset, float(normal @ direction))
    return enter, leave


@dataclass(frozen=True)
class Box(Primitive, FlatFaced):
    """Cuboid with the given half-extents [m] along its own axes."""

    _kind = "box"
    half_extents: tuple[float, float, float]

    @property
    def corners(self) -> Floats:
        """See :class:`Shape`."""
        return corners(self.geom)

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """The planes of the faces, without rounding."""
        return np.vstack([np.eye(3), -np.eye(3)]), np.tile(self.half_extents, 2)

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`; the slab method along the box's own axes."""
        enter, leave = between(origins[0], float(direction[0]), self.half_extents[0])
        for axis in (1, 2):
            enters, leaves = between(origins[axis], float(direction[axis]), self.half_extents[axis])
            np.maximum(enter, enters, out=enter)
            np.minimum(leave, leaves, out=leave)
        return entered(enter, leave)


@dataclass(frozen=True)
class Wedge(FlatFaced):
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
        """See :class:`Shape`."""
        triangle = np.array([[-1, -1], [2, -1], [-1, 2]]) / 3 * (self.length, self.height)
        return np.array([[x, y, z] for y in (-self.half_width, self.half_width) for x, z in triangle])


@dataclass(frozen=True)
class Prism(FlatFaced):
    """Regular prism about its z axis: ``num_sides``, ``radius`` of its edges and ``half_length`` [m]."""

    num_sides: int
    radius: float
    half_length: float

    def __post_init__(self) -> None:
        require_count("num_sides", self.num_sides, 3, 10_000)
        super().__post_init__()

    @property
    def corners(self) -> Floats:
        """See :class:`Shape`."""
        return np.vstack([ring(self.radius, z, self.num_sides) for z in (-self.half_length, self.half_length)])


@dataclass(frozen=True)
class Union:
    """Boxes, cylinders and polyhedra that overlap and share their origin, such as a plate and a boss on it.

    MuJoCo collides with the convex hull of what lies in front of the pad.

    Attributes:
        parts: the solids, at least one.

    Raises:
        ValueError: there is no part, or one is round, as a sphere.

    >>> cross = Union((Box((3.0, 1.0, 1.0)), Box((1.0, 3.0, 1.0))))
    >>> cross.entry_distance(np.array([[2.0, 2.0], [0.0, 2.0], [5.0, 5.0]]), np.array([0.0, 0.0, -1.0])).tolist()
    [4.0, inf]
    """

    parts: tuple[Shape, ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise ValueError("a union needs at least one part")
        for part in self.parts:
            corners(part.geom)  # raises for a round solid

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return max(part.bounding_radius for part in self.parts)

    @cached_property
    def geom(self) -> Geom:
        """The corners of all parts. See :class:`Shape`."""
        return Geom("mesh", vertices=np.vstack([corners(part.geom) for part in self.parts]), presses="surface")

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        return np.min([part.entry_distance(origins, direction) for part in self.parts], axis=0)


@dataclass(frozen=True)
class Cut:
    """What planes leave of a box, a cylinder or a polyhedron, such as a cube without a corner or a shaft with a flat.

    Attributes:
        solid: the convex solid before the cuts.
        planes: an outward normal of any length, and the distance of the plane from the origin [m], of each cut:
            ``(x, y, z, distance)``.

    Raises:
        ValueError: a plane is not four finite numbers with a normal, or cuts the origin off; or the solid is a mesh, a
            torus or a union, which need not be convex; or it is round, as a sphere.

    >>> cube = Cut(Box((1.0, 1.0, 1.0)), ((1.0, 1.0, 0.0, 1.0),))           # without one edge
    >>> cube.entry_distance(np.array([[5.0], [0.0], [0.0]]), np.array([-1.0, 0.0, 0.0])).round(3).tolist()
    [4.0]
    >>> len(cube.geom.vertices)
    10
    """

    solid: Shape
    planes: tuple[tuple[float, float, float, float], ...]

    def __post_init__(self) -> None:
        if isinstance(self.solid, Mesh | Torus | Union):
            raise ValueError(f"only convex solids can be cut, got a {type(self.solid).__name__}")
        corners(self.solid.geom)  # raises for a round solid
        for plane in self.planes:
            if len(plane) != 4 or not np.isfinite(plane).all() or not any(plane[:3]) or plane[3] <= 0.0:
                raise ValueError(
                    f"a plane is a normal (x, y, z) and a distance above zero, so that the origin stays inside; got "
                    f"{plane}"
                )

    @property
    def bounding_radius(self) -> float:
        """That of the solid before the cuts. See :class:`Shape`."""
        return self.solid.bounding_radius

    @cached_property
    def geom(self) -> Geom:
        """The corners that remain; a cylinder has 64 sides. See :class:`Shape`."""
        hull = scipy.spatial.ConvexHull(corners(self.solid.geom)).equations
        normals, distances = self._halfspaces
        cuts = np.column_stack([normals, -distances])
        remaining = scipy.spatial.HalfspaceIntersection(np.vstack([hull, cuts]), np.zeros(3))
        return Geom("mesh", vertices=remaining.intersections)

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        far = 2.0 * (np.linalg.norm(origins, axis=0).max(initial=0.0) + self.bounding_radius)
        enter = self.solid.entry_distance(origins, direction)
        leave = far - self.solid.entry_distance(origins + far * direction[:, None], -direction)
        for normal, distance in zip(*self._halfspaces, strict=True):
            clip(enter, leave, normal @ origins - distance, float(normal @ direction))
        return entered(enter, leave)

    @cached_property
    def _halfspaces(self) -> tuple[Floats, Floats]:
        """Unit normals ``(m, 3)`` and distances ``(m,)`` [m]."""
        planes = np.array(self.planes, float).reshape(-1, 4)
        return planes[:, :3] / np.linalg.norm(planes[:, :3], axis=1, keepdims=True), planes[:, 3]
