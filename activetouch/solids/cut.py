"""Convex solids with parts cut off by planes, and solids joined into one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # whose parts load at first use

from activetouch.solids.mesh import Mesh
from activetouch.solids.round import Torus
from activetouch.solids.solid import Floats, Geom, Shape, clip, corners, entered


@dataclass(frozen=True)
class Union:
    """Boxes, cylinders and polyhedra that overlap and share their origin, such as a plate and a boss on it.

    MuJoCo collides with the convex hull of what lies in front of the pad.

    Attributes:
        parts: the solids, at least one.

    Raises:
        ValueError: there is no part, or one is round, as a sphere.

    >>> from activetouch.solids.straight import Box
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

    >>> from activetouch.solids.straight import Box
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
