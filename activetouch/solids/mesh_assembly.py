"""Scenes of several parts as one surface: each part of a node is put where its parents' transforms place it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import count, islice
from typing import TypeVar

import numpy as np

from activetouch.solids.solid import Floats, Ints

Node = TypeVar("Node")
T = TypeVar("T")

MOST_BYTES = 256 * 2**20
"""Of a mesh file, of all files that it refers to together, and of what it unpacks to."""
_MOST_NODES, _MOST_CORNERS = 50_000, 20_000_000  # nodes are counted as often as they are placed, parts as nodes


def assembled(
    roots: Iterable[tuple[Node, Floats]],
    children: Callable[[Node], Iterable[tuple[Node, Floats]]],
    parts: Callable[[Node], Iterable[tuple[Floats, Ints]]],
) -> tuple[Floats, Ints]:
    """The vertices ``(v, 3)`` and triangles ``(f, 3)`` of a scene. A node is read once, however often it is placed.

    Args:
        roots: nodes of the scene and the transform of each, ``(4, 4)``.
        children: nodes that a node contains, and the transform of each into the node, ``(4, 4)``.
        parts: vertices and triangles of a node itself.

    Raises:
        ValueError: a triangle has a vertex that does not exist, or the scene is too large; a node may contain itself.
    """
    number = count(1)

    def counted(some: Iterable[T]) -> Iterator[T]:
        for one in some:
            if next(number) > _MOST_NODES:
                raise ValueError(f"its scene has more than {_MOST_NODES} nodes, or one contains itself")
            yield one

    def placed() -> Iterator[tuple[Floats, Ints]]:
        known: dict[Node, tuple[Floats, Ints, list[tuple[Node, Floats]]]] = {}
        todo = list(counted(roots))[::-1]
        while todo:
            node, place = todo.pop()
            if node not in known:
                known[node] = *joined(counted(parts(node))), list(islice(children(node), _MOST_NODES + 1))
            points, triangles, inside = known[node]
            if len(triangles):
                yield points @ place[:3, :3].T + place[:3, 3], triangles
            todo.extend((child, place @ within) for child, within in reversed(list(counted(inside))))

    return joined(placed())


def joined(surfaces: Iterable[tuple[Floats, Ints]]) -> tuple[Floats, Ints]:
    """One surface of several; raises ValueError for a vertex that does not exist, and beyond the largest number."""
    vertices, faces, num_vertices, num_corners = [np.empty((0, 3))], [np.empty((0, 3), np.intp)], 0, 0
    for points, triangles in surfaces:
        if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(points):
            wrong = triangles[(triangles < 0) | (triangles >= len(points))][0]
            raise ValueError(f"a face has the vertex {wrong}, counted from 0, and there are {len(points)} vertices")
        if (num_corners := num_corners + triangles.size + len(points)) > _MOST_CORNERS:
            raise ValueError(f"its scene has more than {_MOST_CORNERS} corners and vertices")
        if triangles.size:
            vertices.append(points)
            faces.append(triangles + num_vertices)
            num_vertices += len(points)
    return np.concatenate(vertices), np.concatenate(faces)


def fans(corners: Ints, sizes: Ints) -> Ints:
    """The triangles of polygons, ``(f, 3)``.

    Args:
        corners: of all polygons, one after the other, ``(n,)``.
        sizes: number of corners of each polygon, ``(p,)``.

    Raises:
        ValueError: a polygon has fewer than three corners, or the corners are of another number.

    >>> fans(np.array([0, 1, 2, 3, 7, 8, 9]), np.array([4, 3])).tolist()
    [[0, 1, 2], [0, 2, 3], [7, 8, 9]]
    """
    if sizes.size and (sizes.min() < 3 or sizes.max() > corners.size):
        raise ValueError(f"a face has {sizes.min()} corners, it needs at least 3")
    if sizes.sum() != corners.size:
        raise ValueError(f"its faces have {sizes.sum()} corners, {corners.size} are listed")
    num = sizes - 2
    first = np.repeat(np.cumsum(sizes) - sizes, num)
    step = np.arange(len(first)) - np.repeat(np.cumsum(num) - num, num)
    return corners[np.column_stack([first, first + step + 1, first + step + 2])]
