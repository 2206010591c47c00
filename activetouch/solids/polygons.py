"""Polygons that are not convex, divided into triangles.

A fan from the first corner of a concave polygon covers what lies outside, such as the notch of an L.
"""

from __future__ import annotations

import numpy as np

from activetouch.solids.triangles import Floats, Ints, frame_across

_ROUNDING = 1e-6  # rounding of the coordinates of a file, relative to the largest
_PLANE = 1e-3  # distance from its plane up to which a polygon is flat, relative to its extent
_MOST_CORNERS = 10_000  # largest number of corners, which takes half a minute


def not_fans(vertices: Floats, faces: Ints, begins: Ints) -> Ints:
    """Polygons whose fans, ``(f, 3)``, have triangles that face the wrong way; ``begins``: first triangle of each."""
    if len(begins) == len(faces):  # all polygons are triangles
        return np.arange(0)
    first, second, third = vertices[faces.T]
    areas = np.cross(second - first, third - first)
    whole = np.add.reduceat(areas, begins)
    size = np.linalg.norm(whole, axis=1)
    polygon = np.repeat(np.arange(len(begins)), np.diff(begins, append=len(faces)))
    rounding = _ROUNDING * np.abs(vertices).max(axis=1)[faces].max(axis=1)
    reach = np.linalg.norm(second - first, axis=1) + np.linalg.norm(third - first, axis=1)
    is_wrong = (areas * whole[polygon]).sum(axis=1) < -rounding * reach * size[polygon]
    is_wrong |= (size[polygon] == 0.0) & (np.linalg.norm(areas, axis=1) > rounding * reach)
    return np.flatnonzero(np.logical_or.reduceat(is_wrong, begins))


def ears(corners: Floats) -> Ints:
    """Triangles of a nearly flat polygon, as indices of its m corners, ``(m - 2, 3)``; ValueError if its sides cross.

    Triangles that all face the way of the polygon cover it once, in whichever order corners are cut off: sums of signed
    areas are kept. So a corner is cut off where it is convex and no other corner lies in its triangle; where there is
    no such corner, one whose triangle only touches others, and then one that is on a line with its neighbours.

    >>> ears(np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0)], float)).tolist()
    [[0, 1, 2], [0, 2, 3], [5, 0, 3], [5, 3, 4]]
    """
    if len(corners) > _MOST_CORNERS:
        raise ValueError(f"a face that is not convex has {len(corners)} corners, {_MOST_CORNERS} are the most")
    around = corners - corners.mean(axis=0)
    whole = np.cross(around, np.roll(around, -1, axis=0)).sum(axis=0)
    rounding, extent = _ROUNDING * np.abs(corners).max(), np.ptp(corners, axis=0).max()
    if (area := np.linalg.norm(whole)) > rounding * extent:
        normal = whole / area
        flat = around @ frame_across(normal).T
        flat = flat if _area(flat, np.roll(flat, -1, axis=0)).sum() > 0.0 else flat * (1.0, -1.0)
        if (found := _cut_off(flat, rounding)) is not None:
            return found
        if np.abs(around @ normal).max() > _PLANE * extent:  # it has no inside in its plane
            return np.array([(0, step + 1, step + 2) for step in range(len(corners) - 2)])
    raise ValueError("the sides of a face cross each other; divide it into triangles")


def _cut_off(points: Floats, rounding: float) -> Ints | None:
    """The triangles of a polygon in the plane, counter-clockwise, ``(m, 2)``; None if no more can be cut off."""
    rest, found, last = list(range(len(points))), [], 0
    while len(rest) > 2:
        here = points[rest]
        before, after = np.roll(here, 1, axis=0), np.roll(here, -1, axis=0)
        turn = _area(here - before, after - here)
        limit = rounding * (np.linalg.norm(here - before, axis=1) + np.linalg.norm(after - here, axis=1))
        convex, others = np.flatnonzero(turn > limit), here[turn <= limit]
        order = np.roll(convex, -np.searchsorted(convex, last)).tolist()  # near the corner that was cut off last
        triangles, margins = np.stack([before, here, after], axis=1), (-rounding, rounding)
        free = (place for margin in margins for place in order if not _has_inside(triangles[place], others, margin))
        level = np.flatnonzero(np.abs(turn) <= limit).tolist()
        if (chosen := next(free, level[0] if level else None)) is None:
            return None
        found.append((rest[chosen - 1], rest[chosen], rest[(chosen + 1) % len(rest)]))
        last = max(chosen - 1, 0)
        del rest[chosen]
    return np.array(found)


def _has_inside(triangle: Floats, points: Floats, margin: float) -> bool:
    """Whether points, ``(n, 2)``, that are no corner of a triangle are inside, by more than a margin."""
    sides = np.roll(triangle, -1, axis=0) - triangle
    offsets = points[:, None] - triangle
    depth = _area(sides, offsets) / np.linalg.norm(sides, axis=1)
    is_corner = np.abs(offsets).max(axis=2) <= abs(margin)
    return bool(((depth > margin).all(axis=1) & ~is_corner.any(axis=1)).any())


def _area(one: Floats, other: Floats) -> Floats:
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
