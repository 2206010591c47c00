"""Points and directions; surfaces of triangles: their edges, areas, volumes, and whether they are convex."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Triangles = tuple[Floats, Ints]
"""Vertices ``(v, 3)`` [m] and triangles ``(f, 3)``, counter-clockwise from outside."""
_SAME_SIZE = 1e-6  # relative difference of areas and volumes that are one


def edges(faces: Ints) -> tuple[Ints, Ints, Ints]:
    """Identifiers of the edges: directed, ``(3 f,)``; undirected, ``(3 f,)``; and triangles at each of the latter.

    The edges of a triangle are from each corner to the next, in order.
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    size = int(faces.max()) + 1
    _, edge, sharing = np.unique(
        np.minimum(start, end) * size + np.maximum(start, end), return_inverse=True, return_counts=True
    )
    return start * size + end, edge, sharing


def normals(vertices: Floats, faces: Ints) -> Floats:
    """Vectors across the triangles, counter-clockwise, as long as twice their areas, ``(f, 3)`` [m²]."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def areas(vertices: Floats, faces: Ints) -> Floats:
    """Areas of the triangles, ``(f,)`` [m²]."""
    return np.asarray(np.linalg.norm(normals(vertices, faces), axis=1) / 2)


def tetrahedra(vertices: Floats, faces: Ints) -> Floats:
    """Signed volumes of the tetrahedra between the origin and each triangle, ``(f,)`` [m³]."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.einsum("fi,fi->f", a, np.cross(b, c)) / 6


def is_convex(vertices: Floats, faces: Ints) -> bool:
    """Whether the triangles bound one convex body and face outwards: area and volume are those of its hull.

    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> [is_convex(corners, faces) for faces in (tetrahedron, tetrahedron[:, ::-1], tetrahedron[:3])]
    [True, False, False]
    """
    try:
        hull = scipy.spatial.ConvexHull(vertices)
    except scipy.spatial.QhullError:  # it is flat
        return False
    found = areas(vertices, faces).sum(), tetrahedra(vertices, faces).sum()
    return bool(np.allclose(found, (hull.area, hull.volume), rtol=_SAME_SIZE, atol=0.0))


def bodies_of_vertices(faces: Ints, num_vertices: int) -> Ints:
    """The body of each vertex, ``(v,)``: vertices of one triangle belong to one body."""
    links = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    graph = scipy.sparse.coo_array((np.ones(faces.size), links), (num_vertices, num_vertices))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1])


def are_star_shaped(vertices: Floats, faces: Ints) -> bool:
    """Whether each connected part of the triangles bounds a body that its middle sees whole, and faces outwards.

    Every ray from the middle leaves such a body once, so that its surface does not cross itself, and the union of such
    bodies is met from outside on triangles that face outwards only.

    Args:
        vertices: ``(v, 3)`` [m].
        faces: ``(f, 3)``.

    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> [are_star_shaped(corners, faces) for faces in (tetrahedron, tetrahedron[:, ::-1], tetrahedron[:3])]
    [True, False, False]
    """
    directed, _, sharing = edges(faces)
    if (sharing != 2).any() or len(np.unique(directed)) < len(directed):
        return False
    body = bodies_of_vertices(faces, len(vertices))
    middles = np.stack([np.bincount(body, along) for along in vertices.T]) / np.bincount(body)
    rays = (vertices - middles.T[body])[faces]
    if not (lengths := np.linalg.norm(rays, axis=2, keepdims=True)).all():
        return False
    volumes, angles = solid_angles(rays / lengths)
    around = np.bincount(body[faces[:, 0]], angles)
    return bool((volumes > 0.0).all() and (around < 6.0 * np.pi).all())  # all around once is 4 pi


def solid_angles(rays: Floats) -> tuple[Floats, Floats]:
    """Triple products of unit vectors to the corners of triangles ``(f, 3, 3)``, and signed solid angles, ``(f,)``.

    Source: van Oosterom & Strackee 1983.
    """
    a, b, c = rays.transpose(1, 0, 2)
    volumes = np.einsum("fi,fi->f", a, np.cross(b, c))
    cosines = 1.0 + sum(np.einsum("fi,fi->f", one, other) for one, other in ((a, b), (b, c), (c, a)))
    return volumes, 2.0 * np.arctan2(volumes, cosines)


def portions(counts: Ints, most: int) -> Iterator[slice]:
    """Slices whose counts sum to about ``most``."""
    total = int(counts.sum())
    if total <= most:
        yield slice(0, len(counts))
        return
    ends = np.cumsum(counts)
    cuts = np.searchsorted(ends, np.arange(most, total, most), side="left") + 1
    bounds = np.unique(np.concatenate([[0], cuts, [len(counts)]])).tolist()
    yield from (slice(begin, end) for begin, end in pairwise(bounds))


def on_spiral(heights: Floats) -> Floats:
    """Unit vectors of these heights along z, turned by the golden angle from one to the next, ``(n, 3)``."""
    angle, radius = np.pi * (1.0 + np.sqrt(5.0)) * (np.arange(len(heights)) + 0.5), np.sqrt(1.0 - heights**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heights])


def frame_across(direction: Floats) -> Floats:
    """Unit vectors x and y that form a right-handed frame with z = −direction, ``(2, 3)``."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(x, direction)])


def grid_centres(rows: int, columns: int, pitch: float) -> Floats:
    """Centres of a flat grid about the approach axis, ``(3, rows · columns)`` [m]: rows along z, columns along y."""
    edges = [((np.arange(n) + 0.5) / n * 2 - 1) * (n * pitch / 2) for n in (rows, columns)]
    z, y = np.meshgrid(*edges, indexing="ij")
    return np.stack([np.zeros(z.size), y.ravel(), z.ravel()])
