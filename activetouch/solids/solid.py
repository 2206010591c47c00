"""What a solid is: how far away its surface is along parallel rays, and how MuJoCo collides with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_PARALLEL = 1e-12  # sine of the angle below which a ray counts as parallel to a plane


@dataclass(frozen=True)
class Geom:
    """How MuJoCo collides with a shape: a primitive's ``size`` [m] or the ``vertices`` (n, 3) [m] of a mesh.

    MuJoCo collides with the convex hull of a mesh. The physics of a solid with a hole or a hollow (a torus, a cup)
    is therefore that of its hull, while its touch image is that of its true surface.
    """

    type: str
    size: tuple[float, ...] = ()
    vertices: Floats | None = None


class Shape(Protocol):
    """A solid about its origin, outside of which every ray of the pad starts.

    Shapes are keys of caches: equal ones must hash alike. Their ``repr`` is part of what identifies a run.
    """

    def __hash__(self) -> int: ...

    @property
    def bounding_radius(self) -> float:
        """Radius of an origin-centred ball that holds the solid, the smallest such ball if known [m]."""

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


def require_lengths(solid: object, *lengths: float) -> None:
    """Refuse a solid that has no size, or one without end.

    Raises:
        ValueError: a length is not finite or not above zero; shows the solid.
    """
    if not (np.isfinite(lengths).all() and min(lengths) > 0.0):
        raise ValueError(f"a solid needs finite lengths above zero, got {solid}")


def ahead(distance: Floats) -> Floats:
    """The distances themselves, with ``inf`` for what lies behind a ray's start."""
    return np.where(distance >= 0.0, distance, np.inf)


def clip(enter: Floats, leave: Floats, height: Floats, slope: float) -> None:
    """Cut the intervals ``[enter, leave]`` of the rays, in place, to the half-space under a plane.

    Applied to every plane of a convex solid this is the slab method. A ray along a plane is either under it or
    misses, so that no quotient of two rounding errors decides where it enters.

    Args:
        enter: distances at which the rays enter what they were cut to before, ``(n,)`` [m].
        leave: distances at which they leave it, ``(n,)`` [m]; below ``enter`` for a miss.
        height: height of the ray starts above the plane, ``(n,)`` [m].
        slope: height gained per metre of ray, the same for all.
    """
    if slope < -_PARALLEL:
        np.maximum(enter, height / -slope, out=enter)
    elif slope > _PARALLEL:
        np.minimum(leave, height / -slope, out=leave)
    else:
        leave[height > 0.0] = -np.inf


def quadratic_roots(a: float, half_b: Floats, c: Floats) -> tuple[Floats, Floats]:
    """Roots of a·t² + 2·half_b·t + c, without cancellation; NaN where there is none.

    With a = 0 one root is NaN and the other is the linear one, which is what the callers need.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        q = -(half_b + np.copysign(np.sqrt(half_b**2 - a * c), half_b))
        return q / a if a != 0 else np.full_like(q, np.nan), c / q


def ring(radius: float, z: float, num_points: int) -> Floats:
    """Corners of a regular polygon about the z axis, the first on the x axis, ``(num_points, 3)`` [m]."""
    angle = np.linspace(0.0, 2 * np.pi, num_points, endpoint=False)
    return np.column_stack([np.cos(angle) * radius, np.sin(angle) * radius, np.full(num_points, z)])
