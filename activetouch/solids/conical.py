"""Solids of revolution with straight sides: frustum, cylinder, cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from activetouch.solids.solid import Floats, Geom, ahead, quadratic_roots, require_lengths, ring

_SLACK = 1.0 + 1e-12  # so that no ray passes between side and cap


@dataclass(frozen=True)
class Frustum:
    """Truncated circular cone about its z axis, origin at half height.

    Attributes:
        bottom_radius: radius at the bottom [m].
        top_radius: radius at the top, smaller or larger [m].
        height: from bottom to top [m].
        num_facets: number of sides of the mesh for MuJoCo, which has no frustum.
    """

    bottom_radius: float
    top_radius: float
    height: float
    num_facets: int = 64

    def __post_init__(self) -> None:
        require_lengths(self, self.bottom_radius, self.height)
        if not 0.0 <= self.top_radius < np.inf:
            raise ValueError(f"top_radius must be finite and ≥ 0, got {self}")

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.hypot(max(self.bottom_radius, self.top_radius), self.height / 2))

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        bottom = ring(self.bottom_radius, -self.height / 2, self.num_facets)
        top = ring(self.top_radius, self.height / 2, self.num_facets)
        return Geom("mesh", vertices=np.vstack([bottom, top]))

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        (x, y, z), (dx, dy, dz) = origins, direction
        half_height = self.height / 2
        slope = (self.bottom_radius - self.top_radius) / self.height
        radius = (self.bottom_radius + self.top_radius) / 2 - slope * z  # of the cone at the rays' starts
        a = float(dx * dx + dy * dy - (slope * dz) ** 2)
        half_b = x * dx
        half_b += y * dy
        half_b += (slope * dz) * radius
        c = x * x
        c += y * y
        c -= radius * radius
        entry: Floats | None = None
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for t in _entries(a, half_b, c):
                # The height limit also discards the mirror cone beyond the apex.
                height = t * dz
                height += z
                on_side = np.abs(height, out=height) <= half_height * _SLACK
                found = np.where(on_side, t, np.inf)
                entry = found if entry is None else np.minimum(entry, found, out=entry)
            assert entry is not None, "there is at least one root"
            cap, rim = (-half_height, self.bottom_radius) if dz > 0.0 else (half_height, self.top_radius)
            if dz != 0.0 and rim > 0.0:  # the cap that faces the ray
                t = cap - z
                t /= dz
                across, along = t * dx, t * dy
                across += x
                along += y
                across *= across
                along *= along
                across += along
                np.minimum(entry, np.where(across <= (rim * _SLACK) ** 2, t, np.inf), out=entry)
        return ahead(entry)


def _entries(a: float, half_b: Floats, c: Floats) -> tuple[Floats, ...]:
    """Roots of a·t² + 2·half_b·t + c at which a ray may enter a cone; NaN if there is none.

    For a > 0 the ray is inside between the two roots, so it enters at the first. Ahead of the ray half_b is negative
    then, so the difference below is a sum; behind it the root is negative and does not count.
    """
    if a <= 0.0:
        return quadratic_roots(a, half_b, c)
    root = half_b * half_b
    root -= a * c
    np.sqrt(root, out=root)
    root -= half_b
    return (np.divide(c, root, out=root),)


@dataclass(frozen=True)
class Cylinder:
    """Circular cylinder about its z axis: ``radius`` and ``half_length`` [m]."""

    radius: float
    half_length: float

    def __post_init__(self) -> None:
        require_lengths(self, self.radius, self.half_length)

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
        return Frustum(self.radius, self.radius, 2 * self.half_length).entry_distance(origins, direction)


@dataclass(frozen=True)
class Cone:
    """Circular cone about its z axis, origin at half height: base ``radius`` at the bottom, ``height`` [m]."""

    radius: float
    height: float
    num_facets: int = 64

    def __post_init__(self) -> None:
        require_lengths(self, self.radius, self.height)

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.hypot(self.radius, self.height / 2))

    @property
    def geom(self) -> Geom:
        """A pyramid with ``num_facets`` sides, because MuJoCo has no cone. See :class:`Shape`."""
        base = ring(self.radius, -self.height / 2, self.num_facets)
        return Geom("mesh", vertices=np.vstack([base, [0.0, 0.0, self.height / 2]]))

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        return Frustum(self.radius, 0.0, self.height).entry_distance(origins, direction)
