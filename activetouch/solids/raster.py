"""Height maps of triangles by a z-buffer, in many orientations at once, without loops over triangles or pixels.

The middle corner divides a triangle into two halves. The pixels of a row that a half covers lie between its crossings
with two edges. Of all values written to a pixel, the greatest stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from activetouch.solids.triangles import are_star_shaped, normals, portions
from activetouch.solids.vectors import Floats, Ints

_MOST = 1 << 18  # rows, or pixels, written at a time; limits memory to about 100 MB
_PORTION = 1 << 14  # pixels, or triangles, at a time, so that arrays stay in the processor's cache
_NARROW = 1e-6  # triangles that are narrower along the rows are level there [pixels]
_FLAT = 1e-30  # smallest extent of an edge across the rows [pixels]
_SLACK = 1e-9  # widening of triangles along the rows, far above rounding [pixels]
_STARTS, _ENDS = (0, 0, 1), (2, 1, 2)  # corners of the edges low to high, low to middle, middle to high
# Low, middle and high corner by a > b, b > c, c > a, in binary from the right; the last cannot be.
_ORDERS = np.array([(0, 1, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0), (0, 1, 2), (1, 0, 2), (0, 2, 1), (0, 1, 2)]).T.copy()
_DROP = 0.125  # of the greatest height below the highest vertex, that is first thought of [pixels]
_FEW = 300  # triangles, of which none is left out, because to find out which would take longer


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles, prepared for :func:`heights`.

    Attributes:
        vertices: ``(3, v)`` [m].
        faces: corners of the triangles, ``(3, f)``.
        normals: that point outwards, of any length, ``(3, f)``, of surfaces of which no triangle that faces away is
            met; None for others: a surface that crosses itself may show its inside.
    """

    vertices: Floats
    faces: Ints
    normals: Floats | None

    @classmethod
    def of(cls, vertices: Floats, faces: Ints, is_sound: bool = False) -> Surface:
        """Of vertices ``(v, 3)`` [m] and triangles ``(f, 3)``.

        Args:
            vertices: of the triangles.
            faces: their corners.
            is_sound: whether the triangles are known to face outwards, and the surface to be closed without crossing
                itself, or to be several such surfaces. By default they may face either way, and only those of
                star-shaped bodies are found to be sound.
        """
        corners = np.ascontiguousarray(vertices.T), np.ascontiguousarray(faces.T)
        if not is_sound and not are_star_shaped(vertices, faces):
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
    faces, num_faces, num_vertices = surface.faces, surface.faces.shape[1], surface.vertices.shape[1]
    step = max(1, _PORTION // max(num_pixels**2, num_faces))
    for first in range(0, len(turns), step):
        some = slice(first, first + step)
        corners = axes[:, some] @ surface.vertices  # row and column [pixels] and height [m], (3, b, v)
        corners[:2] += shifts[:, some]
        if surface.normals is None:
            shown = np.arange(corners.shape[1] * num_faces)
        else:
            shown = (axes[2, some] @ surface.normals > 0.0).ravel().nonzero()[0]
        image = shown // num_faces
        of_face = faces.take(shown - image * num_faces, axis=1)
        of_face += image * num_vertices
        row = corners[0].take(of_face)
        low, high = np.ceil(row.min(axis=0)), np.floor(row.max(axis=0))
        crossed = (np.maximum(low, 0.0) <= np.minimum(high, num_pixels - 1)).nonzero()[0]
        point = corners.reshape(3, -1).take(of_face.take(crossed, axis=1), axis=1)
        _draw(point, num_pixels, image.take(crossed) * num_pixels**2, maps[some].reshape(-1))
    return maps


def foremost(surface: Surface, turn: Floats, place: Floats, pixel: float, num_pixels: int, within: float) -> Floats:
    """The map of :func:`heights` ``(num_pixels, num_pixels)`` for one orientation, down to a depth.

    Heights up to ``within`` below the greatest [m] are those of :func:`heights`. Farther down, a map may show what lies
    behind or nothing, because triangles that end lower are left out.
    """
    reached = np.empty((num_pixels, num_pixels))
    reached.fill(-np.inf)
    axes = turn[::-1] / [[pixel], [pixel], [-1.0]]
    corners = axes @ surface.vertices  # row and column [pixels] and height [m], (3, v)
    corners[:2] += (place[::-1] / pixel + (num_pixels - 1) / 2)[:, None]
    is_small = surface.faces.shape[1] <= _FEW
    lowest = -np.inf if is_small else _highest(corners, num_pixels) - _DROP * pixel  # at most the greatest height
    one, other, third = surface.faces
    while True:
        if lowest > -np.inf:  # few of these face away, and none of those is the foremost
            reaching = corners[2] >= lowest - within
            shown = reaching.take(one)
            shown |= reaching.take(other)
            shown |= reaching.take(third)
            some = surface.faces.take(shown.nonzero()[0], axis=1)
        elif surface.normals is not None:
            some = surface.faces.compress(axes[2] @ surface.normals > 0.0, axis=1)
        else:
            some = surface.faces
        _draw(corners.take(some, axis=1), num_pixels, 0.0, reached.reshape(-1))
        if (found := reached.max()) >= lowest:
            return reached
        lowest = found  # the highest corner lies between pixels: less high ones count as well


def _highest(corners: Floats, num_pixels: int) -> float:
    """The greatest height of a vertex over the square; ``-inf`` if there is none."""
    row, column, height = corners[:, corners[2].argmax()].tolist()
    if -0.5 <= row <= num_pixels - 0.5 and -0.5 <= column <= num_pixels - 0.5:
        return float(height)
    inside = (np.abs(corners[:2] - (num_pixels - 1) / 2) <= num_pixels / 2).all(axis=0)
    return float(corners[2].max(initial=-np.inf, where=inside))


def _draw(point: Floats, size: int, image: Floats | float, pixels: NDArray[Any]) -> None:
    """Write triangles into maps ``(b * size * size,)``, whose heights are replaced by greater ones.

    Args:
        point: row, column and height of their corners, ``(3 coordinates, 3 corners, k)``.
        size: rows of a map.
        image: where the map of each begins, ``(k,)``, or of all.
        pixels: the maps.
    """
    row, number = point[0], point.shape[2]
    greater = (row > row.take((1, 2, 0), axis=0)).view(np.int8)
    order = _ORDERS.take(greater[0] + 2 * greater[1] + 4 * greater[2], axis=1)  # low, middle, high
    order *= number
    order += np.arange(number)
    point = point.reshape(3, -1).take(order, axis=1)

    edge = point.take(_ENDS, axis=1)
    edge -= point.take(_STARTS, axis=1)
    slope = edge[1:] / np.maximum(edge[0], _FLAT)  # of column and height, (2, 3, k)
    begin = np.ceil(point[0])
    begin[2] = np.floor(point[0, 2]) + 1.0
    np.minimum(np.maximum(begin, 0.0, out=begin), size, out=begin)
    first, count = begin[:2], (begin[1:] - begin[:2]).astype(np.intp).ravel()  # rows of the lower and of the upper half
    column, height = point[1:, 0] + edge[0, 1] * slope[:, 0] - point[1:, 1]  # of the long edge beside the middle corner
    column[np.abs(column) < _NARROW] = np.inf
    half = np.empty((10, *first.shape))  # column and height at the long edge, column at the other, place in the maps,
    half[4:6], half[6], half[7] = slope[:, :1], slope[0, 1:], size  # their slopes along the rows,
    half[8] = height / column  # and that of the height along the columns
    np.multiply(first - point[0, 0], half[4:6], out=half[:2])
    half[:2] += point[1:, :1]
    np.multiply(first - point[0, :2], half[6], out=half[2])
    half[2] += point[1, :2]
    np.multiply(first, size, out=half[3])
    half[3] += image
    half = half.reshape(10, -1)
    for some in portions(count, _MOST):
        _draw_rows(half[:, some], count[some], size, pixels)


def _draw_rows(half: Floats, count: Ints, size: int, pixels: NDArray[Any]) -> None:
    """Write halves of triangles with ``count`` rows each; see :func:`_draw`."""
    half[9] = count.cumsum() - count  # how many rows come before
    row = half.repeat(count, axis=1)
    row[4:8] *= np.arange(row.shape[1]) - row[9]
    row[:4] += row[4:8]
    column, value, other, place, *_, slope, _ = row
    left, right = np.minimum(column, other), np.maximum(column, other)
    start, stop = np.ceil(left - _SLACK), np.floor(right + _SLACK)
    np.maximum(start, 0.0, out=start)
    np.minimum(stop, size - 1, out=stop)
    stop -= start
    stop += 1.0
    count = np.maximum(stop, 0.0, out=stop).astype(np.intp)
    np.minimum(np.maximum(start, left, out=left), right, out=left)  # heights stay those of the triangle
    left -= column
    left *= slope
    value += left
    place += start
    for some in portions(count, _MOST):
        _draw_pixels(place[some].astype(np.intp), value[some], slope[some], count[some], pixels)


def _draw_pixels(place: Ints, value: Floats, slope: Floats, count: Ints, pixels: NDArray[Any]) -> None:
    """Write parts of rows that begin at ``place``, with ``count`` pixels each."""
    before = count.cumsum()
    index = np.arange(before[-1] if len(count) else 0)
    before -= count
    values = (index - before.repeat(count)) * slope.repeat(count)
    values += value.repeat(count)
    place -= before
    index += place.repeat(count)
    np.maximum.at(pixels, index, values.astype(pixels.dtype, copy=False))
