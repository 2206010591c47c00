"""Edges, areas and volumes of a surface of triangles."""

from __future__ import annotations

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.solids.solid import Floats

Ints = NDArray[np.intp]

_SAME = 1e-6  # relative difference of areas and volumes that are one


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
    return bool(np.allclose(found, (hull.area, hull.volume), rtol=_SAME, atol=0.0))
