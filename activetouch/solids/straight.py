"""Convex solids with flat faces: box, wedge and prism."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # whose parts load at first use

from activetouch.solids.solid import Floats, Geom, between, clip, corners, entered, require_lengths, ring
from belief.validation import require_count


class FlatFaced(ABC):
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
class Box(FlatFaced):
    """Cuboid with the given half-extents [m] along its own axes."""

    half_extents: tuple[float, float, float]

    def __post_init__(self) -> None:
        require_lengths(self, *self.half_extents)

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

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return Geom("box", self.half_extents)


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

    def __post_init__(self) -> None:
        require_lengths(self, self.length, self.height, self.half_width)

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
        require_count("num_sides", self.num_sides, 3)
        require_lengths(self, self.radius, self.half_length)

    @property
    def corners(self) -> Floats:
        """See :class:`Shape`."""
        return np.vstack([ring(self.radius, z, self.num_sides) for z in (-self.half_length, self.half_length)])
