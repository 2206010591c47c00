"""The part of a hollow object's surface that a rigid pad can touch, for MuJoCo, whose meshes are convex.

A flat pad that moves along x meets the points in front of its face and no others, and it reaches none that lies behind
their convex hull. The hull of these points, extended away from the pad, therefore makes first contact where the true
surface does. The walls of a hollow beside the pad are not touched.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.poses import to_matrix
from activetouch.pressing.pad import Pad
from activetouch.solids.solid import Geom

Floats = NDArray[np.float64]

_NUM_DIRECTIONS = 32  # in which the hull is exact, besides the one towards the pad


def facing_geom(pad: Pad, placement: Placement, gap: Floats, touching: float) -> Geom | None:
    """What stands for the object in MuJoCo in this press; None if the shape's own geom does.

    Args:
        pad: the pad.
        placement: the object.
        gap: from :func:`activetouch.pressing.contact.first_touch`, ``(num_taxels, num_taxels)`` [m].
        touching: distance of the object's centre from the pad at the first touch, from the same function [m].

    Returns:
        Vertices in the object's frame at nominal size.
    """
    if placement.shape.geom.presses != "surface":
        return None
    met = np.isfinite(gap.ravel())
    points = pad.taxel_centres[:, met]
    points[0] = gap.ravel()[met] - touching
    points[1:] -= np.asarray(placement.offset)[:, None]
    half_taxel = pad.half_width / pad.num_taxels
    if not met.any():  # a miss: out of the reach of the pad
        points = np.array([[placement.bounding_radius + 4 * pad.half_thickness], [0.0], [0.0]])
    directions = _towards_the_pad()
    hull = points[:, np.argmax(directions @ points, axis=1)]
    hull[1:] += half_taxel * np.where(directions.T[1:] < 0.0, -1.0, 1.0)  # a taxel is a square
    behind = hull + np.array([[2 * pad.half_thickness], [0.0], [0.0]])
    solid = to_matrix(placement.orientation).T @ np.hstack([hull, behind])
    return Geom("mesh", vertices=solid.T / placement.scale)


def _towards_the_pad() -> Floats:
    """Unit vectors that cover the half-space of the pad evenly, the one along its normal first, ``(n, 3)``."""
    place = np.arange(_NUM_DIRECTIONS) + 0.5
    x, angle = place / _NUM_DIRECTIONS, place * np.pi * (1.0 + np.sqrt(5.0))
    across = np.sqrt(1.0 - x * x)
    spread = np.column_stack([-x, across * np.cos(angle), across * np.sin(angle)])
    return np.vstack([[-1.0, 0.0, 0.0], spread])
