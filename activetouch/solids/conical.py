"""Solids of revolution with straight sides: frustum, cylinder, cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from activetouch.solids.solid import Floats, Geom, between, entered, quadratic_roots, require_lengths, ring
from belief.validation import require_count

_ALONG = 1e-10  # relative difference of slopes below which a ray counts as parallel to a line on the side of a cone


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
        require_count("num_facets", self.num_facets, 3)

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
        """See :class:`Shape`; the part of a cone between two planes, by the slab method."""
        (x, y, z), (dx, dy, dz) = origins, direction.tolist()
        slope = (self.bottom_radius - self.top_radius) / self.height
        radius = (self.bottom_radius + self.top_radius) / 2 - slope * z if slope else self.bottom_radius
        growth = -slope * dz  # of that radius along a ray
        half_b = x * dx
        half_b += y * dy
        half_b -= growth * radius
        c = x * x
        c += y * y
        c -= radius * radius
        a = dx * dx + dy * dy - growth * growth
        enter, leave = between(z, dz, self.height / 2)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            if abs(a) < _ALONG * growth * growth:  # along the side: one crossing
                crossing = c / (-2.0 * half_b)
                np.maximum(enter, crossing, out=enter, where=half_b < 0.0)
                np.minimum(leave, crossing, out=leave, where=half_b > 0.0)
                leave[(half_b == 0.0) & (c > 0.0)] = -np.inf
            elif a > 0.0:
                # Inside between the roots. Ahead of a ray half_b is negative, so the difference below is a sum.
                root = half_b * half_b
                root -= a * c
                np.sqrt(root, out=root)
                root -= half_b
                np.divide(c, root, out=c)
                np.maximum(enter, c, out=enter)
                root /= a
                np.minimum(leave, root, out=leave)
            elif growth:  # inside before the first root and beyond the second, one of them in the mirror cone
                roots = quadratic_roots(a, half_b, c)
                if growth > 0.0:
                    enter = np.fmax(enter, np.fmax(*roots))
                else:
                    leave = np.fmin(leave, np.fmin(*roots))
            else:  # along a cylinder
                leave[c > 0.0] = -np.inf
        return entered(enter, leave)


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
        require_count("num_facets", self.num_facets, 3)

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
