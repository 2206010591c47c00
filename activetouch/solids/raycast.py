"""First intersections of parallel rays with a closed surface of triangles, without loops over rays or triangles.

In the plane perpendicular to the rays, rays are points. The points are sorted into √n rows, and within a row from left
to right. For every row that a triangle crosses, binary search finds the rays between its left and right side. Only
these (triangle, ray) pairs are tested.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_MAX_PAIRS = 1 << 18  # tested at a time; limits memory to about 100 MB
_NARROWEST = 1e-9  # smallest extent of the rays [m], if they lie on a line
_MARGIN = 1e-9  # relative widening of rows and triangles against rounding


def first_entry(vertices: Floats, faces: Ints, origins: Floats, direction: Floats) -> Floats:
    """Distance along rays to the first triangle that faces them [m]; ``inf`` if there is none.

    No ray passes between two triangles with a common edge: the signed areas that decide this differ only in sign.

    Args:
        vertices: ``(v, 3)`` [m].
        faces: corners of the triangles, counter-clockwise from outside, ``(f, 3)``.
        origins: ray starts, ``(3, n)`` [m].
        direction: one unit vector ``(3,)`` shared by all rays.

    Returns:
        ``(n,)``, in ``[0, inf]``.
    """
    frame = _frame_towards_viewer(direction)
    ray_x, ray_y, ray_start = frame[0] @ origins, frame[1] @ origins, direction @ origins
    nearest = np.full(ray_x.size, np.inf)
    x, y = (vertices @ frame[0])[faces].T, (vertices @ frame[1])[faces].T  # (3, f)
    depth = vertices @ direction
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    in_view = area > 0.0  # triangles that face the rays
    for corner, ray in ((x, ray_x), (y, ray_y)):
        in_view &= (corner.max(axis=0) >= ray.min()) & (corner.min(axis=0) <= ray.max())
    faces, x, y = faces[in_view], x[:, in_view], y[:, in_view]

    rows = _Rows(ray_x, ray_y)
    for triangle, ray in rows.pairs(x, y):
        ax, bx, cx = x[:, triangle] - ray_x[ray]
        ay, by, cy = y[:, triangle] - ray_y[ray]
        weights = np.stack([bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx])
        total = weights.sum(axis=0)
        hit = np.flatnonzero((weights.min(axis=0) >= 0.0) & (total > 0.0))
        corners = depth[faces[triangle[hit]]].T
        distance = (weights[:, hit] * corners).sum(axis=0) / total[hit] - ray_start[ray[hit]]
        ahead = distance >= 0.0
        np.minimum.at(nearest, ray[hit[ahead]], distance[ahead])
    return nearest


def _frame_towards_viewer(direction: Floats) -> Floats:
    """Unit vectors x and y that form a right-handed frame with z = −direction, ``(2, 3)``."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(x, direction)])


class _Rows:
    """Rays, sorted into rows of equal height, and within a row from left to right."""

    def __init__(self, x: Floats, y: Floats) -> None:
        self._num = max(1, int(np.sqrt(x.size)))
        self._left, self._bottom = float(x.min()), float(y.min())
        self._width = max(float(np.ptp(x)), _NARROWEST) * (1 + _MARGIN)
        self._height = max(float(np.ptp(y)), _NARROWEST) / self._num
        row, along = self._row(y), (x - self._left) / self._width
        self._order = np.lexsort((along, row))
        self._place = (row + along)[self._order]  # one sort key, because along is in [0, 1)

    def _row(self, y: Floats) -> Ints:
        rows = (y - self._bottom) / self._height
        return np.clip(rows, 0, self._num - 1).astype(np.intp)

    def pairs(self, x: Floats, y: Floats) -> Iterator[tuple[Ints, Ints]]:
        """Indices of triangles and of rays that may hit them, in portions; corners are at x and y, ``(3, f)`` [m]."""
        lowest = self._row(y.min(axis=0))
        num_rows = self._row(y.max(axis=0)) - lowest + 1
        for some in _portions(num_rows):
            triangle, row = _expand(some.start, lowest[some], num_rows[some])
            left, right = self._sides(x[:, triangle], y[:, triangle], row)
            first = np.searchsorted(self._place, row + left, side="left")
            last = np.searchsorted(self._place, row + right, side="right")
            num_rays = np.maximum(last - first, 0)
            for part in _portions(num_rays):
                crossing, place = _expand(part.start, first[part], num_rays[part])
                yield triangle[crossing], self._order[place]

    def _sides(self, x: Floats, y: Floats, row: Ints) -> tuple[Floats, Floats]:
        """Left and right end of each triangle in its row, in ``[0, 1]``."""
        x = (x - self._left) / self._width
        y = (y - self._bottom) / self._height - row  # the row is from 0 to 1
        low, high = -_MARGIN * self._num, 1.0 + _MARGIN * self._num
        next_x, next_y = np.roll(x, -1, axis=0), np.roll(y, -1, axis=0)
        rise = next_y - y
        slant = np.divide(next_x - x, rise, out=np.zeros_like(x), where=rise != 0.0)
        begin, end = np.clip(y, low, high), np.clip(next_y, low, high)
        at_begin, at_end = x + slant * (begin - y), next_x + slant * (end - next_y)
        crosses = (np.minimum(y, next_y) <= high) & (np.maximum(y, next_y) >= low)
        left = np.where(crosses, np.minimum(at_begin, at_end), np.inf).min(axis=0) - _MARGIN
        right = np.where(crosses, np.maximum(at_begin, at_end), -np.inf).max(axis=0) + _MARGIN
        return np.clip(left, 0.0, 1.0), np.clip(right, 0.0, 1.0 - 1e-12)


def _expand(offset: int, starts: Ints, counts: Ints) -> tuple[Ints, Ints]:
    """Range index i + ``offset`` and value of all numbers in the ranges ``starts[i] … starts[i] + counts[i] - 1``."""
    owner = np.repeat(np.arange(len(counts)), counts)
    value = np.arange(len(owner)) + (starts - (np.cumsum(counts) - counts))[owner]
    return owner + offset, value


def _portions(counts: Ints) -> Iterator[slice]:
    """Slices whose counts sum to about ``_MAX_PAIRS``."""
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    cuts = np.searchsorted(ends, np.arange(_MAX_PAIRS, total, _MAX_PAIRS), side="left") + 1
    bounds = np.unique(np.concatenate([[0], cuts, [len(counts)]])).tolist()
    return (slice(begin, end) for begin, end in pairwise(bounds))
