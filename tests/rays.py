"""Rays against the triangles of a solid, one by one: the oracle of the height maps."""

import numpy as np

from activetouch.solids.triangles import around_origin, portions
from activetouch.solids.vectors import frame_across

_MOST_PAIRS = 1 << 18


def entry(solid, origins, direction):
    """Distance at which parallel rays ``(3, n)`` first meet the solid from outside, ``(n,)``; inf for a miss."""
    return first_entry(solid.surface.vertices.T, solid.surface.faces.T, origins, direction)


def first_entry(vertices, faces, origins, direction):
    """Distance along rays to the first triangle, whichever side it shows [m]; ``inf`` if there is none.

    A grid of rays is faster with :func:`activetouch.solids.raster.heights`. No ray passes between two triangles with a
    common edge: the signed areas that decide this differ only in sign.

    Args:
        vertices: ``(v, 3)`` [m].
        faces: corners of the triangles, ``(f, 3)``.
        origins: ray starts, ``(3, n)`` [m].
        direction: one unit vector ``(3,)`` shared by all rays.

    Returns:
        ``(n,)``, in ``[0, inf]``.
    """
    frame = frame_across(direction)
    order = np.argsort(frame[1] @ origins)
    ray_x, ray_y, ray_start = np.vstack([frame, direction]) @ origins[:, order]
    nearest = np.full(ray_x.size, np.inf)
    x, y = (vertices @ frame[0])[faces].T, (vertices @ frame[1])[faces].T  # (3, f)
    depth = vertices @ direction
    begin = np.searchsorted(ray_y, y.min(axis=0), side="left")
    num_rays = np.searchsorted(ray_y, y.max(axis=0), side="right") - begin
    for some in portions(num_rays, _MOST_PAIRS):
        count = num_rays[some]
        triangle = np.arange(some.start, some.stop).repeat(count)
        ray = np.arange(len(triangle)) + (begin[some] - np.cumsum(count) + count).repeat(count)
        corners = np.stack([x[:, triangle] - ray_x[ray], y[:, triangle] - ray_y[ray]], axis=1)
        hit, weights, total = around_origin(corners)
        distance = (weights * depth[faces[triangle[hit]]].T).sum(axis=0) / total - ray_start[ray[hit]]
        ahead = distance >= 0.0
        np.minimum.at(nearest, order[ray[hit[ahead]]], distance[ahead])
    return nearest
