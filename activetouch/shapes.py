"""The shapes an object can have: exact ray geometry for touch images, and a collision geom for MuJoCo.

A shape is a solid centred on its own origin. For the touch image we only need, for every taxel, how far
the surface is along the pad's normal: the distance at which a ray from the taxel *enters* the solid.
For the four primitives that distance has a closed form, exact to rounding (tests compare it with
``mujoco.mj_ray``).

To add a shape, write a class with the three members of :class:`Shape` and put one instance into
:data:`SHAPES`. Everything else (K, labels, planners, reports) follows from that table.

    >>> import numpy as np
    >>> sphere = SHAPES["sphere"]
    >>> sphere.entry_distance(np.array([[-0.05], [0.0], [0.0]]), np.array([1.0, 0.0, 0.0]))
    array([0.03])
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Geom:
    """How MuJoCo collides with a shape: a primitive's ``size`` [m] or a convex mesh's ``vertices`` (n, 3) [m]."""

    type: str
    size: tuple[float, ...] = ()
    vertices: Floats | None = None


class Shape(Protocol):
    """A solid centred on its origin, outside of which every ray of the pad starts."""

    @property
    def bounding_radius(self) -> float:
        """Radius of the smallest origin-centred ball that holds the solid [m]."""

    @property
    def geom(self) -> Geom:
        """The collision geometry handed to MuJoCo."""

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """Distance at which rays first meet the solid [m]; ``inf`` for a ray that misses it.

        Args:
            origins: ray starts, ``(3, n)`` [m], all outside the solid, object frame.
            direction: one unit vector ``(3,)`` shared by all rays, object frame.

        Returns:
            ``(n,)``, in ``[0, inf]``.
        """


def _first_valid(*candidates: tuple[Floats, NDArray[np.bool_]]) -> Floats:
    """The smallest candidate distance whose surface point is really on the solid; inf where none is."""
    return np.min([np.where(valid, distance, np.inf) for distance, valid in candidates], axis=0)


def _quadratic_roots(a: float, half_b: Floats, c: Floats) -> tuple[Floats, Floats]:
    """Roots of a·t² + 2·half_b·t + c, without cancellation; NaN where there is none.

    With a = 0 one root is infinite and the other is the linear one, which is what the callers need.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        q = -(half_b + np.copysign(np.sqrt(half_b**2 - a * c), half_b))
        return q / a if a != 0 else np.full_like(q, np.nan), c / q


@dataclass(frozen=True)
class Sphere:
    """Ball of the given ``radius`` [m]."""

    radius: float

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return self.radius

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return Geom("sphere", (self.radius, 0.0, 0.0))

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        along = direction @ origins  # (n,)
        with np.errstate(invalid="ignore"):
            half_chord = np.sqrt(along**2 - (np.einsum("in,in->n", origins, origins) - self.radius**2))
        return np.where(np.isnan(half_chord), np.inf, -along - half_chord)


@dataclass(frozen=True)
class Box:
    """Cuboid with the given half-extents [m] along its own axes."""

    half_extents: tuple[float, float, float]

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.linalg.norm(self.half_extents))

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return Geom("box", self.half_extents)

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        entry = np.full(origins.shape[1], -np.inf)
        exit_ = np.full(origins.shape[1], np.inf)
        for o, d, h in zip(origins, direction, self.half_extents, strict=True):
            if d == 0.0:  # parallel to this pair of faces: inside the slab or missed
                exit_ = np.where(np.abs(o) <= h, exit_, -np.inf)
            else:
                near, far = (-np.copysign(h, d) - o) / d, (np.copysign(h, d) - o) / d
                entry, exit_ = np.maximum(entry, near), np.minimum(exit_, far)
        return np.where(entry <= exit_, entry, np.inf)


@dataclass(frozen=True)
class Cylinder:
    """Circular cylinder about its z axis: ``radius`` and ``half_length`` [m]."""

    radius: float
    half_length: float

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.hypot(self.radius, self.half_length))

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return Geom("cylinder", (self.radius, self.half_length, 0.0))

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        (x, y, z), (dx, dy, dz) = origins, direction
        candidates = []
        for t in _quadratic_roots(dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - self.radius**2):
            candidates.append((t, np.abs(z + t * dz) <= self.half_length))
        if dz != 0.0:  # the cap that faces the ray
            t = (-np.copysign(self.half_length, dz) - z) / dz
            candidates.append((t, (x + t * dx) ** 2 + (y + t * dy) ** 2 <= self.radius**2))
        return _first_valid(*candidates)


@dataclass(frozen=True)
class Cone:
    """Circular cone about its z axis, origin at half height: base ``radius`` at the bottom, ``height`` [m]."""

    radius: float
    height: float
    num_facets: int = 64

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.hypot(self.radius, self.height / 2))

    @property
    def geom(self) -> Geom:
        """A convex pyramid of ``num_facets`` facets: MuJoCo has no cone. See :class:`Shape`."""
        angle = np.linspace(0.0, 2 * np.pi, self.num_facets, endpoint=False)
        rim = np.column_stack([np.cos(angle), np.sin(angle)]) * self.radius
        base = np.column_stack([rim, np.full(self.num_facets, -self.height / 2)])
        return Geom("mesh", vertices=np.vstack([base, [0.0, 0.0, self.height / 2]]))

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        (x, y, z), (dx, dy, dz) = origins, direction
        slope = self.radius / self.height
        below_apex = self.height / 2 - z  # the radius shrinks linearly towards the apex
        roots = _quadratic_roots(
            dx * dx + dy * dy - (slope * dz) ** 2,
            x * dx + y * dy + slope**2 * below_apex * dz,
            x * x + y * y - (slope * below_apex) ** 2,
        )
        # The height limit also discards the mirror cone above the apex.
        candidates = [(t, np.abs(z + t * dz) <= self.height / 2) for t in roots]
        if dz > 0.0:  # only a ray that climbs can enter through the base
            t = (-self.height / 2 - z) / dz
            candidates.append((t, (x + t * dx) ** 2 + (y + t * dy) ** 2 <= self.radius**2))
        return _first_valid(*candidates)


SHAPES: Mapping[str, Shape] = MappingProxyType(
    {
        "sphere": Sphere(0.020),
        "cube": Box((0.016, 0.016, 0.016)),
        "cylinder": Cylinder(radius=0.016, half_length=0.020),
        "cone": Cone(radius=0.018, height=0.036),
    }
)
"""The paper's four shapes, at their nominal size (sizes: decision 0003)."""
