"""Round solids: sphere, ellipsoid, capsule, half sphere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from activetouch.solids.conical import Cylinder
from activetouch.solids.solid import Floats, Geom, ahead, clip, entered, require_lengths, ring
from belief.validation import require_count


def _chord(origins: Floats, direction: Floats, radius: float) -> tuple[Floats, Floats]:
    """Distance to the middle of each ray's chord in a ball, and half the length of the chord; NaN for a miss."""
    along = direction @ origins  # (n,)
    with np.errstate(invalid="ignore"):
        half_chord = along * along
        half_chord -= np.einsum("in,in->n", origins, origins) - radius**2
        np.sqrt(half_chord, out=half_chord)
    return np.negative(along, out=along), half_chord


@dataclass(frozen=True)
class Sphere:
    """Ball of the given ``radius`` [m]."""

    radius: float

    def __post_init__(self) -> None:
        require_lengths(self, self.radius)

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
        middle, half_chord = _chord(origins, direction, self.radius)
        return ahead(middle - half_chord)


@dataclass(frozen=True)
class Ellipsoid:
    """Ellipsoid with the given half-axes [m] along its own axes."""

    half_axes: tuple[float, float, float]

    def __post_init__(self) -> None:
        require_lengths(self, *self.half_axes)

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return max(self.half_axes)

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return Geom("ellipsoid", self.half_axes)

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        half_axes = np.asarray(self.half_axes)
        squeezed = direction / half_axes  # in coordinates in which the ellipsoid is the unit ball
        stretch = float(np.linalg.norm(squeezed))
        return Sphere(1.0).entry_distance(origins / half_axes[:, None], squeezed / stretch) / stretch


@dataclass(frozen=True)
class Capsule:
    """Cylinder about its z axis with a half ball at both ends: ``radius``, ``half_length`` of the cylinder [m]."""

    radius: float
    half_length: float

    def __post_init__(self) -> None:
        require_lengths(self, self.radius, self.half_length)

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return self.radius + self.half_length

    @property
    def geom(self) -> Geom:
        """See :class:`Shape`."""
        return Geom("capsule", (self.radius, self.half_length, 0.0))

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
        require_count("num_facets", self.num_facets, 4)

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
