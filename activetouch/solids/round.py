"""Round solids: frustum, cylinder, cone, sphere, ellipsoid, capsule, half sphere, torus."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from activetouch.solids.solid import Floats, Geom, Ints, Primitive, between, clip, entered, require_lengths, ring
from belief.validation import require_count

_ALONG = 1e-10  # relative difference of slopes below which a ray counts as parallel to a line on the side of a cone
_MAX_STEPS = 60  # of the root of a quartic, more than bisection needs
_CONVERGED = 1e-11  # in units of the ring's radius; the step of Newton's method that is below is still made


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
        require_count("num_facets", self.num_facets, 3, 10_000)

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
                roots = _quadratic_roots(a, half_b, c)
                if growth > 0.0:
                    enter = np.fmax(enter, np.fmax(*roots))
                else:
                    leave = np.fmin(leave, np.fmin(*roots))
            else:  # along a cylinder
                leave[c > 0.0] = -np.inf
        return entered(enter, leave)


@dataclass(frozen=True)
class Cylinder(Primitive):
    """Circular cylinder about its z axis: ``radius`` and ``half_length`` [m]."""

    _kind = "cylinder"
    radius: float
    half_length: float

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.hypot(self.radius, self.half_length))

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
        require_count("num_facets", self.num_facets, 3, 10_000)

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


@dataclass(frozen=True)
class Sphere(Primitive):
    """Ball of the given ``radius`` [m]."""

    _kind = "sphere"
    radius: float

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return self.radius

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        middle, half_chord = _chord(origins, direction, self.radius)
        return _ahead(middle - half_chord)


@dataclass(frozen=True)
class Ellipsoid(Primitive):
    """Ellipsoid with the given half-axes [m] along its own axes."""

    _kind = "ellipsoid"
    half_axes: tuple[float, float, float]

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return max(self.half_axes)

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        half_axes = np.asarray(self.half_axes)
        squeezed = direction / half_axes  # in coordinates in which the ellipsoid is the unit ball
        stretch = float(np.linalg.norm(squeezed))
        return Sphere(1.0).entry_distance(origins / half_axes[:, None], squeezed / stretch) / stretch


@dataclass(frozen=True)
class Capsule(Primitive):
    """Cylinder about its z axis with a half ball at both ends: ``radius``, ``half_length`` of the cylinder [m]."""

    _kind = "capsule"
    radius: float
    half_length: float

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return self.radius + self.half_length

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`; the capsule is the union of a cylinder and two balls."""
        end = np.array([[0.0], [0.0], [self.half_length]])
        ball = Sphere(self.radius)
        ends = np.minimum(ball.entry_distance(origins - end, direction), ball.entry_distance(origins + end, direction))
        return np.minimum(ends, Cylinder(self.radius, self.half_length).entry_distance(origins, direction))


@dataclass(frozen=True)
class Dome:
    """Half ball of the given ``radius`` [m], flat side down, origin at half height."""

    radius: float
    num_facets: int = 64

    def __post_init__(self) -> None:
        require_lengths(self, self.radius)
        require_count("num_facets", self.num_facets, 4, 10_000)

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.hypot(self.radius, self.radius / 2))

    @property
    def geom(self) -> Geom:
        """A polyhedron, because MuJoCo has no half ball. See :class:`Shape`."""
        elevations = np.linspace(0.0, np.pi / 2, self.num_facets // 4, endpoint=False)
        rings = [
            ring(self.radius * np.cos(e), self.radius * (np.sin(e) - 0.5), self.num_facets) for e in elevations.tolist()
        ]
        return Geom("mesh", vertices=np.vstack([*rings, [0.0, 0.0, self.radius / 2]]))

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        from_centre = origins + np.array([[0.0], [0.0], [self.radius / 2]])  # of the whole ball
        middle, half_chord = _chord(from_centre, direction, self.radius)
        enter, leave = middle - half_chord, middle + half_chord
        clip(enter, leave, -from_centre[2], -float(direction[2]))
        return entered(enter, leave)


@dataclass(frozen=True)
class Torus:
    """Ring around its z axis: ``ring_radius`` of its centre line, ``tube_radius`` of its cross-section [m].

    MuJoCo collides with its convex hull, so that the results of the scenes with a torus stay: a simulated press on the
    hole meets a flat face.
    """

    ring_radius: float
    tube_radius: float
    num_facets: int = 64

    def __post_init__(self) -> None:
        if not 0.0 < self.tube_radius < self.ring_radius < np.inf:
            raise ValueError(f"tube_radius must be in (0, ring_radius), got {self.tube_radius} and {self.ring_radius}")
        require_count("num_facets", self.num_facets, 4, 10_000)

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return self.ring_radius + self.tube_radius

    @property
    def geom(self) -> Geom:
        """The outer half of the tube, which has the same convex hull. See :class:`Shape`."""
        angles = np.linspace(-np.pi / 2, np.pi / 2, self.num_facets // 4 + 1)
        across, up = self.ring_radius + self.tube_radius * np.cos(angles), self.tube_radius * np.sin(angles)
        rings = [ring(a, z, self.num_facets) for a, z in zip(across.tolist(), up.tolist(), strict=True)]
        return Geom("mesh", vertices=np.vstack(rings), presses="hull")

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`.

        Along a ray, with s measured from the point nearest to the centre in units of the ring's radius, the torus is
        where s⁴ + b·s² + c·s + d ≤ 0. The quartic has at most two minima. The ray enters before the first minimum if
        the quartic is negative there, else between the maximum and the second minimum. It decreases on both intervals.
        """
        tube = self.tube_radius / self.ring_radius
        nearest = -(direction @ origins)
        distance = np.full(len(nearest), np.inf)
        foot = (origins + nearest * direction[:, None]) / self.ring_radius
        miss = np.einsum("in,in->n", foot, foot)  # squared distance of the ray from the centre
        near = np.flatnonzero(miss < (1.0 + tube) ** 2)
        if near.size == 0:
            return distance
        z, miss, dz = foot[2, near], miss[near], float(direction[2])
        k = miss + 1.0 - tube**2
        b = 2 * k - 4 * (1.0 - dz * dz)
        c = 8 * z * dz
        d = k * k - 4 * (miss - z * z)
        first, middle, second = _turning_points(b / 2, c / 4)
        # The first interval may lie behind the start of the ray, if it starts in the hole.
        enters_first = (_quartic(first, b, c, d) <= 0.0) & (first >= -nearest[near] / self.ring_radius)
        enters = enters_first | (_quartic(second, b, c, d) <= 0.0)
        low = np.where(enters_first, -np.sqrt((1.0 + tube) ** 2 - miss), middle)[enters]
        high = np.where(enters_first, first, second)[enters]
        root = _falling_root(low, high, b[enters], c[enters], d[enters])
        distance[near[enters]] = nearest[near[enters]] + self.ring_radius * root
        return _ahead(distance)


def _quartic(s: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    return ((s * s + b) * s + c) * s + d


def _turning_points(p: Floats, q: Floats) -> tuple[Floats, Floats, Floats]:
    """Real roots of s³ + p·s + q in increasing order; a single root is returned three times."""
    third, half = p / 3, q / 2
    discriminant = half * half + third * third * third
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.sqrt(-third)
        cosine = np.cos(np.arccos(np.clip(half / (third * scale), -1.0, 1.0)) / 3)
        sine = np.sqrt(3.0 - 3.0 * cosine * cosine)  # times the root of 3
        first, middle, second = scale * (-cosine - sine), scale * (sine - cosine), 2 * scale * cosine
    one = np.flatnonzero(~(discriminant < 0.0))
    if one.size:
        radical = -np.copysign(np.cbrt(np.abs(half[one]) + np.sqrt(discriminant[one])), q[one])
        single = radical - np.divide(third[one], radical, out=np.zeros_like(radical), where=radical != 0.0)
        for points in (first, middle, second):
            points[one] = single
    return first, middle, second


def _falling_root(low: Floats, high: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Root of a quartic that decreases from ≥ 0 to ≤ 0 in an interval: Newton's method, safeguarded by bisection."""
    root = low.copy()
    active: Ints = np.arange(len(root))
    s = low.copy()
    for _ in range(_MAX_STEPS):
        value = _quartic(s, b, c, d)
        fall = -((4 * s * s + 2 * b) * s + c)
        low, high = np.where(value > 0.0, s, low), np.where(value > 0.0, high, s)
        with np.errstate(over="ignore"):
            newton = s + np.divide(value, fall, out=np.full_like(s, np.inf), where=fall > 0.0)
        step = np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
        moved = np.abs(step - s) > _CONVERGED
        root[active] = step
        if not moved.any():
            break
        if moved.mean() < 0.7:  # remove converged rays
            active, s, low, high = active[moved], step[moved], low[moved], high[moved]
            b, c, d = b[moved], c[moved], d[moved]
        else:
            s = step
    return root


def _chord(origins: Floats, direction: Floats, radius: float) -> tuple[Floats, Floats]:
    """Distance to the middle of each ray's chord in a ball, and half the length of the chord; NaN for a miss."""
    along = direction @ origins  # (n,)
    with np.errstate(invalid="ignore"):
        half_chord = along * along
        half_chord -= np.einsum("in,in->n", origins, origins) - radius**2
        np.sqrt(half_chord, out=half_chord)
    return np.negative(along, out=along), half_chord


def _ahead(distance: Floats) -> Floats:
    """The distances, with negative ones and NaN replaced by ``inf``."""
    return np.where(distance >= 0.0, distance, np.inf)


def _quadratic_roots(a: float, half_b: Floats, c: Floats) -> tuple[Floats, Floats]:
    """Roots of a·t² + 2·half_b·t + c with a ≠ 0, without cancellation; NaN if there is none."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        q = -(half_b + np.copysign(np.sqrt(half_b**2 - a * c), half_b))
        return q / a, c / q
