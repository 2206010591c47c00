"""Height maps of triangles by a z-buffer, in many orientations at once, without loops over triangles or pixels.

The middle corner divides a triangle into two halves. The pixels of a row that a half covers lie between its crossings
with two edges. Of all values written to a pixel, the greatest stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from activetouch.solids.triangles import Floats, Ints, are_star_shaped, normals, portions

_MOST = 1 << 18  # rows, or pixels, written at a time; limits memory to about 100 MB
_PORTION = 1 << 14  # pixels, or triangles, at a time, so that arrays stay in the processor's cache
_NARROW = 1e-6  # triangles that are narrower along the rows are level there [pixels]
_FLAT = 1e-30  # smallest extent of an edge across the rows [pixels]
_SLACK = 1e-9  # widening of triangles along the rows, far above rounding [pixels]
_STARTS, _ENDS = np.array([(0, 0, 1), (2, 1, 2)])  # corners of the edges low to high, low to middle, middle to high
_NEXT, _BITS = np.array([1, 2, 0]), np.array([1, 2, 4], np.int8)
# Of the column at the long edge, its height, and the column at the other edge, for the lower and the upper half: where
# rows are counted from, values there, both among (row, column, height) × corners, and slopes, among (column, height) ×
# edges.
_ORIGINS, _BASES, _SLOPES = np.array([(0, 0, 0, 0, 0, 1), (3, 3, 6, 6, 3, 4), (0, 0, 3, 3, 1, 2)])
# Low, middle and high corner by a > b, b > c, c > a, in binary from the right; the last cannot be.
_ORDERS = np.array([(0, 1, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0), (0, 1, 2), (1, 0, 2), (0, 2, 1), (0, 1, 2)]).T.copy()
_MARGIN = 1e-6  # by which triangles that are left out miss every pixel, above the slack and rounding [pixels]
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


@cache
def _keep_freed_memory() -> None:
    """Let the C library of Linux keep the memory that maps need.

    It returns free memory above twice its largest freed block to the system, and asks for it again for the next map,
    which can more than double the time. After a block of 8 MB it does not.
    """
    np.empty(2**20)


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
    _render(surface, turns, places, pixel, maps)
    return maps


def first_faces(surface: Surface, turns: Floats, places: Floats, pixel: float, num_pixels: int, same: float) -> Ints:
    """The triangle of a surface with normals that :func:`heights` shows over each pixel that shows one, ``(n,)``.

    Of triangles whose heights are the same when rounded to ``same`` [m], it is the one with the least number.
    """
    keys = np.full((len(turns), num_pixels, num_pixels), -np.inf)
    steps = 1 << surface.faces.shape[1].bit_length()
    reach = np.linalg.norm(surface.vertices, axis=0).max() * np.linalg.norm(turns[:, 0], axis=1).max()
    unit = max(same, float(reach) * steps / 2**51)  # so that keys are exact
    _render(surface, turns / [[unit], [1.0], [1.0]], places, pixel, keys, steps)
    found = keys[keys > -np.inf]
    return ((np.ceil(found) - found) * steps).astype(np.intp)


def _render(surface: Surface, turns: Floats, places: Floats, pixel: float, maps: NDArray[Any], steps: int = 0) -> None:
    """Write a surface into maps ``(n, m, m)``: heights; or with ``steps``, these rounded, less face / steps."""
    _keep_freed_memory()
    num_pixels = maps.shape[1]
    axes = turns.transpose(1, 0, 2)[::-1] * np.array([1 / pixel, 1 / pixel, -1.0])[:, None, None]
    shifts = places.T[::-1, :, None] / pixel + (num_pixels - 1) / 2
    faces, num_faces, num_vertices = surface.faces, surface.faces.shape[1], surface.vertices.shape[1]
    step = max(1, _PORTION // max(num_pixels**2, num_faces // 2))  # half of them face away
    for first in range(0, len(turns), step):
        some = slice(first, first + step)
        corners = axes[:, some] @ surface.vertices  # row and column [pixels] and height [m], (3, b, v)
        corners[:2] += shifts[:, some]
        if surface.normals is None:
            shown = np.arange(corners.shape[1] * num_faces)
        else:
            shown = (axes[2, some] @ surface.normals > 0.0).ravel().nonzero()[0]
        image = shown // num_faces
        face = shown - image * num_faces
        of_face = faces.take(face, axis=1)
        of_face += image * num_vertices
        for along in corners[:2]:
            seen = _over_pixels(along.take(of_face), num_pixels)
            image, face, of_face = image.take(seen), face.take(seen), of_face.take(seen, axis=1)
        point, less = corners.reshape(3, -1).take(of_face, axis=1), face / steps if steps else None
        _draw(point, num_pixels, image * num_pixels**2, maps[some].reshape(-1), less)


def foremost(surface: Surface, turn: Floats, place: Floats, pixel: float, num_pixels: int, within: float) -> Floats:
    """The map of :func:`heights` ``(num_pixels, num_pixels)`` for one orientation, down to a depth.

    Heights up to ``within`` below the greatest [m] are those of :func:`heights`. Farther down, a map may show what lies
    behind or nothing, because triangles that end lower are left out.
    """
    _keep_freed_memory()
    reached = np.empty((num_pixels, num_pixels))
    reached.fill(-np.inf)
    axes = turn[::-1] / np.array(((pixel,), (pixel,), (-1.0,)))
    corners = axes @ surface.vertices  # row and column [pixels] and height [m], (3, v)
    corners[:2] += (place[::-1] / pixel + (num_pixels - 1) / 2)[:, None]
    is_small = surface.faces.shape[1] <= _FEW
    lowest = -np.inf if is_small else _highest(corners, num_pixels) - _DROP * pixel  # at most the greatest height
    while True:
        if lowest > -np.inf:  # few of these face away, and none of those is the foremost
            one, other, third = surface.faces
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


def _over_pixels(corners: Floats, size: int) -> Ints:
    """Triangles that reach over the middle of a row or column, by their corners across it, ``(3, k)`` [pixels]."""
    low, high = np.ceil(corners.min(axis=0) - _MARGIN), np.floor(corners.max(axis=0) + _MARGIN)
    return (np.maximum(low, 0.0) <= np.minimum(high, size - 1)).nonzero()[0]


def _highest(corners: Floats, num_pixels: int) -> float:
    """The greatest height of a vertex over the square; ``-inf`` if there is none."""
    row, column, height = corners[:, corners[2].argmax()].tolist()
    if -0.5 <= row <= num_pixels - 0.5 and -0.5 <= column <= num_pixels - 0.5:
        return float(height)
    inside = (np.abs(corners[:2] - (num_pixels - 1) / 2) <= num_pixels / 2).all(axis=0)
    return float(corners[2].max(initial=-np.inf, where=inside))


def _draw(point: Floats, size: int, image: Floats | float, pixels: NDArray[Any], less: Floats | None = None) -> None:
    """Write triangles into maps ``(b * size * size,)``, whose heights are replaced by greater ones.

    Args:
        point: row, column and height of their corners, ``(3 coordinates, 3 corners, k)``.
        size: rows of a map.
        image: where the map of each begins, ``(k,)``, or of all.
        pixels: the maps.
        less: what is subtracted from the heights of each, which are rounded before, ``(k,)``.
    """
    row, number = point[0], point.shape[2]
    greater = (row > row.take(_NEXT, axis=0)).view(np.int8)
    order = _ORDERS.take(_BITS @ greater, axis=1)  # low, middle, high
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
    half = np.empty((9 if less is None else 10, *first.shape))  # the three values, place in the maps,
    slope.reshape(6, -1).take(_SLOPES, axis=0, out=half[4:7].reshape(6, -1))  # their slopes along the rows,
    half[7], half[8] = size, height / column  # and that of the height along the columns
    corner = point.reshape(9, -1)
    np.subtract(first, corner.take(_ORIGINS, axis=0).reshape(3, 2, -1), out=half[:3])
    half[:3] *= half[4:7]
    half[:3] += corner.take(_BASES, axis=0).reshape(3, 2, -1)
    np.multiply(first, size, out=half[3])
    half[3] += image
    if less is not None:
        half[9] = less
    half = half.reshape(len(half), -1)
    for some in portions(count, _MOST):
        _draw_rows(half[:, some], count[some], size, pixels)


def _draw_rows(half: Floats, count: Ints, size: int, pixels: NDArray[Any]) -> None:
    """Write halves of triangles with ``count`` rows each; see :func:`_draw`."""
    owner = np.arange(len(count)).repeat(count)
    row = half.take(owner, axis=1, mode="clip")  # in half the time of repeat
    row[4:8] *= _counted(count, owner)
    row[:4] += row[4:8]
    column, value, other, place, *_, slope = row[:9]
    less = row[9] if len(row) > 9 else None
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
        part = None if less is None else less[some]
        _draw_pixels(place[some].astype(np.intp), value[some], slope[some], count[some], pixels, part)


def _draw_pixels(
    place: Ints, value: Floats, slope: Floats, count: Ints, pixels: NDArray[Any], less: Floats | None
) -> None:
    """Write parts of rows that begin at ``place``, with ``count`` pixels each."""
    owner = np.arange(len(count)).repeat(count)
    values = _counted(count, owner)
    index = values.astype(np.intp)
    values *= slope.take(owner, mode="clip")
    values += value.take(owner, mode="clip")
    if less is not None:
        np.rint(values, out=values)
        values -= less.take(owner, mode="clip")
    index += place.take(owner, mode="clip")
    np.maximum.at(pixels, index, values.astype(pixels.dtype, copy=False))


def _counted(count: Ints, owner: Ints) -> Floats:
    """Numbers from 0 up within each group of ``count`` elements, which ``owner`` names."""
    number = np.arange(float(len(owner)))
    number -= (count.cumsum() - count).astype(np.float64).take(owner, mode="clip")
    return number
