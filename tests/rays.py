"""Rays against the triangles of a solid, one by one: the oracle of the height maps."""

import numpy as np

from activetouch.solids.triangles import frame_across, on_spiral, portions

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


def first_met_one_by_one(vertices, faces, num_directions=32, num_pixels=32):
    """The oracle of :func:`activetouch.solids.examination.first_met`: it tests each ray with each box that holds it."""
    found = []
    for direction in on_spiral(1 - 2 * (np.arange(num_directions) + 0.5) / num_directions):
        across, depth = vertices @ (frame_across(direction) * [[1.0], [-1.0]]).T, vertices @ direction
        across = (across - across.min(axis=0)) / np.maximum(np.ptp(across, axis=0), 1e-12) * num_pixels - 0.5
        corners = across[faces]
        first, last = np.ceil(corners.min(axis=1)).astype(int), np.floor(corners.max(axis=1)).astype(int)
        size = np.maximum(last - first + 1, 0)
        num = size.prod(axis=1)
        triangle = np.repeat(np.arange(len(faces)), num)
        place = np.arange(len(triangle)) - np.repeat(np.cumsum(num) - num, num)
        pixel = first[triangle] + np.column_stack(np.divmod(place, size[triangle, 1]))
        hit, weights, area = around_origin((corners[triangle] - pixel[:, None]).transpose(1, 2, 0))
        ray, triangle, is_back = pixel[hit] @ (num_pixels, 1), triangle[hit], area > 0.0
        distance = (weights * depth[faces[triangle]].T).sum(axis=0) / area
        order = np.lexsort((is_back, np.round(distance / 1e-9), ray))
        nearest = order[np.unique(ray[order], return_index=True)[1]]
        found.append((triangle[nearest], is_back[nearest]))
    return tuple(map(np.concatenate, zip(*found, strict=True)))


def around_origin(corners):
    """Which triangles of a plane ``(3, 2, n)`` hold its origin: numbers ``(h,)``, weights ``(3, h)``, and their sum.

    A weight is twice the signed area between the origin and the opposite edge. Those of two triangles with a common
    edge differ only in sign, so that no origin is between them.
    """
    a, b, c = corners
    weights = np.stack([b[0] * c[1] - b[1] * c[0], c[0] * a[1] - c[1] * a[0], a[0] * b[1] - a[1] * b[0]])
    area = weights.sum(axis=0)
    hit = np.flatnonzero(((weights.min(axis=0) >= 0.0) | (weights.max(axis=0) <= 0.0)) & (area != 0.0))
    return hit, weights[:, hit], area[hit]
