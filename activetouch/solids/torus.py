"""The torus."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.solids.solid import Floats, Geom, ahead, ring
from belief.validation import require_count

_MAX_STEPS = 60  # more than bisection needs
_CONVERGED = 1e-11  # in units of the ring's radius; the step of Newton's method that is below is still made


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
        require_count("num_facets", self.num_facets, 4)

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
        return ahead(distance)


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
    active: NDArray[np.intp] = np.arange(len(root))
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
