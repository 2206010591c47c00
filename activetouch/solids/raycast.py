"""First intersections of parallel rays with triangles, for rays that lie anywhere.

A grid of rays is faster with :func:`activetouch.solids.raster.heights`.
"""

from __future__ import annotations

import numpy as np

from activetouch.solids.raster import portions
from activetouch.solids.solid import Floats, Ints

_MAX_PAIRS = 1 << 18  # of a triangle and a ray, tested at a time; limits memory to about 100 MB


def first_entry(vertices: Floats, faces: Ints, origins: Floats, direction: Floats) -> Floats:
    """Distance along rays to the first triangle, whichever side it shows [m]; ``inf`` if there is none.

    No ray passes between two triangles with a common edge: the signed areas that decide this differ only in sign.

    Args:
        vertices: ``(v, 3)`` [m].
        faces: corners of the triangles, ``(f, 3)``.
        origins: ray starts, ``(3, n)`` [m].
        direction: one unit vector ``(3,)`` shared by all rays.

    Returns:
        ``(n,)``, in ``[0, inf]``.
    """
    frame = _frame_towards_viewer(direction)
    order = np.argsort(frame[1] @ origins)
    ray_x, ray_y, ray_start = np.vstack([frame, direction]) @ origins[:, order]
    nearest = np.full(ray_x.size, np.inf)
    x, y = (vertices @ frame[0])[faces].T, (vertices @ frame[1])[faces].T  # (3, f)
    depth = vertices @ direction
    begin = np.searchsorted(ray_y, y.min(axis=0), side="left")
    num_rays = np.searchsorted(ray_y, y.max(axis=0), side="right") - begin
    for some in portions(num_rays, _MAX_PAIRS):
        count = num_rays[some]
        triangle = np.arange(some.start, some.stop).repeat(count)
        ray = np.arange(len(triangle)) + (begin[some] - np.cumsum(count) + count).repeat(count)
        ax, bx, cx = x[:, triangle] - ray_x[ray]
        ay, by, cy = y[:, triangle] - ray_y[ray]
        weights = np.stack([bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx])
        total = weights.sum(axis=0)
        hit = np.flatnonzero(((weights.min(axis=0) >= 0.0) | (weights.max(axis=0) <= 0.0)) & (total != 0.0))
        corners = depth[faces[triangle[hit]]].T
        distance = (weights[:, hit] * corners).sum(axis=0) / total[hit] - ray_start[ray[hit]]
        ahead = distance >= 0.0
        np.minimum.at(nearest, order[ray[hit[ahead]]], distance[ahead])
    return nearest


def _frame_towards_viewer(direction: Floats) -> Floats:
    """Unit vectors x and y that form a right-handed frame with z = −direction, ``(2, 3)``."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(x, direction)])
