"""Height maps of triangles by a z-buffer, in many orientations at once, without loops over triangles or pixels.

The middle corner divides a triangle into two halves. The pixels of a row that a half covers lie between its crossings
with two edges. Of all values written to a pixel, the greatest stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from activetouch.solids.solid import Floats, Ints
from activetouch.solids.triangles import are_star_shaped, normals, portions

_MOST = 1 << 18  # rows, or pixels, written at a time; limits memory to about 100 MB
_PORTION = 1 << 14  # pixels, or triangles, at a time, so that arrays stay in the processor's cache
_NARROW = 1e-6  # triangles that are narrower along the rows are level there [pixels]
_FLAT = 1e-30  # smallest extent of an edge across the rows [pixels]
_SLACK = 1e-9  # widening of triangles along the rows, far above rounding [pixels]
_STARTS, _ENDS = (0, 0, 1), (2, 1, 2)  # corners of the edges low to high, low to middle, middle to high
# Low, middle and high corner by a > b, b > c, c > a, in binary from the right; the last cannot be.
_ORDERS = np.array([(0, 1, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0), (0, 1, 2), (1, 0, 2), (0, 2, 1), (0, 1, 2)]).T.copy()


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles, prepared for :func:`heights`.

    Attributes:
        vertices: ``(3, v)`` [m].
        faces: corners of the triangles, ``(3, f)``.
        normals: that point outwards, of any length, ``(3, f)``, of star-shaped bodies and their unions, of which no
            triangle that faces away is met; None for others: a surface that crosses itself may show its inside.
    """

    vertices: Floats
    faces: Ints
    normals: Floats | None

    @classmethod
    def of(cls, vertices: Floats, faces: Ints) -> Surface:
        """Of vertices ``(v, 3)`` [m] and triangles ``(f, 3)``, whichever way they face."""
        corners = np.ascontiguousarray(vertices.T), np.ascontiguousarray(faces.T)
        if not are_star_shaped(vertices, faces):
            return cls(*corners, None)
        return cls(*corners, np.ascontiguousarray(normals(vertices, faces).T))


def heights(
    surface: Surface, turns: Floats, places: Floats, pixel: float, num_pixels: int, dtype: DTypeLike = np.float64
) -> NDArray[Any]:
    """How far a surface reaches along −x over every pixel of a square about the x axis.

    No ray passes between two triangles with a common edge, because all are widened by more than rounding.

    Args:
        surface: the triangles.
        turns: rotation matrices times size factors, ``(n, 3, 3)``.
        places: of the origin along y and z [m], ``(n, 2)``.
        pixel: its edge [m].
        num_pixels: along an edge of the square.
        dtype: of the result.

    Returns:
        ``(n, num_pixels, num_pixels)`` [m], rows along z, columns along y; ``-inf`` where there is no surface.
    """
    maps = np.full((len(turns), num_pixels, num_pixels), -np.inf, dtype)
    axes = turns.transpose(1, 0, 2)[::-1] * np.array([1 / pixel, 1 / pixel, -1.0])[:, None, None]
    shifts = places.T[::-1, :, None] / pixel + (num_pixels - 1) / 2
    step = max(1, _PORTION // max(num_pixels**2, surface.faces.shape[1]))
    for first in range(0, len(turns), step):
        some = slice(first, first + step)
        corners = axes[:, some] @ surface.vertices  # row and column [pixels] and height [m], (3, b, v)
        corners[:2] += shifts[:, some]
        visible = None if surface.normals is None else (-axes[2, some] @ surface.normals < 0.0)
        _draw(corners, surface.faces, visible, maps[some])
    return maps


def _draw(corners: Floats, faces: Ints, visible: NDArray[np.bool_] | None, maps: NDArray[Any]) -> None:
    """Write the triangles ``(3, f)`` into ``maps`` ``(b, N, N)``.

    Args:
        corners: row, column and height of every vertex in every map, ``(3, b, v)``.
        faces: their corners.
        visible: which of them to write, ``(b, f)``; all by default.
        maps: heights, replaced by greater ones.
    """
    _, num_maps, num_vertices = corners.shape
    size, num_faces = maps.shape[-1], faces.shape[1]
    shown = np.arange(num_maps * num_faces) if visible is None else visible.ravel().nonzero()[0]
    image = shown // num_faces
    of_face = faces.take(shown - image * num_faces, axis=1)
    of_face += image * num_vertices
    row = corners[0].take(of_face)
    low, high = np.ceil(row.min(axis=0)), np.floor(row.max(axis=0))
    crossed = (np.maximum(low, 0.0) <= np.minimum(high, size - 1)).nonzero()[0]
    greater = row.take(crossed, axis=1)
    greater = (greater > greater.take((1, 2, 0), axis=0)).view(np.int8)
    order = _ORDERS.take(greater[0] + 2 * greater[1] + 4 * greater[2], axis=1)  # low, middle, high
    point = corners.reshape(3, -1).take(of_face.ravel().take(order * len(shown) + crossed), axis=1)  # (3, 3, k)

    edge = point.take(_ENDS, axis=1) - point.take(_STARTS, axis=1)
    slope = edge[1:] / np.maximum(edge[0], _FLAT)  # of column and height, (2, 3, k)
    begin = np.ceil(point[0])
    begin[2] = high.take(crossed) + 1.0
    begin = begin.clip(0.0, size)
    first, count = begin[:2], (begin[1:] - begin[:2]).astype(np.intp)  # rows of the lower and of the upper half, (2, k)
    column, height = point[1:, 0] + edge[0, 1] * slope[:, 0] - point[1:, 1]  # of the long edge beside the middle corner
    half = np.empty((9, *first.shape))  # column and height at the long edge, column at the other, place in the maps,
    half[4:6], half[6], half[7] = slope[:, :1], slope[0, 1:], size  # their slopes along the rows,
    half[8] = height / np.where(np.abs(column) < _NARROW, np.inf, column)  # and that of the height along the columns
    np.multiply(first - point[0, 0], half[4:6], out=half[:2])
    half[:2] += point[1:, :1]
    np.multiply(first - point[0, :2], half[6], out=half[2])
    half[2] += point[1, :2]
    half[3] = (image.take(crossed) * size + first) * size
    half, count = half.reshape(9, -1), count.ravel()
    for some in portions(count, _MOST):
        _draw_rows(half[:, some], count[some], size, maps.reshape(-1))


def _draw_rows(half: Floats, count: Ints, size: int, pixels: NDArray[Any]) -> None:
    """Write halves of triangles with ``count`` rows each; see :func:`_draw`."""
    owner = np.arange(len(count)).repeat(count)
    row = half.take(owner, axis=1)
    along = np.arange(len(owner)) - (count.cumsum() - count).take(owner)
    row[4:8] *= along
    row[:4] += row[4:8]
    column, height, other, place, *_, slope = row
    left, right = np.minimum(column, other), np.maximum(column, other)
    start, stop = np.ceil(left - _SLACK), np.floor(right + _SLACK)
    np.maximum(start, 0.0, out=start)
    np.minimum(stop, size - 1, out=stop)
    stop -= start
    count = np.maximum(stop + 1.0, 0.0).astype(np.intp)
    value = height + (np.minimum(np.maximum(start, left), right) - column) * slope
    place += start
    for some in portions(count, _MOST):
        _draw_pixels(place[some].astype(np.intp), value[some], slope[some], count[some], pixels)


def _draw_pixels(place: Ints, value: Floats, slope: Floats, count: Ints, pixels: NDArray[Any]) -> None:
    """Write parts of rows that begin at ``place``, with ``count`` pixels each."""
    owner = np.arange(len(count)).repeat(count)
    along = np.arange(len(owner)) - (count.cumsum() - count).take(owner)
    values = slope.take(owner)
    values *= along
    values += value.take(owner)
    index = place.take(owner)
    index += along
    np.maximum.at(pixels, index, values.astype(pixels.dtype, copy=False))
