"""Edges, areas and volumes of a surface of triangles."""

from __future__ import annotations

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from activetouch.solids.solid import Floats

Ints = NDArray[np.intp]


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


def faces_outwards(vertices: Floats, faces: Ints) -> bool:
    """Whether the triangles bound closed bodies, one or several, and those of every body face away from its inside.

    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> [faces_outwards(corners, faces) for faces in (tetrahedron, tetrahedron[:, ::-1], tetrahedron[:3])]
    [True, False, False]
    """
    directed, edge, sharing = edges(faces)
    if (sharing != 2).any() or len(np.unique(directed)) < len(directed):
        return False
    pairs = np.argsort(edge).reshape(-1, 2).T // 3
    touching = scipy.sparse.coo_array((np.ones(pairs.shape[1]), tuple(pairs)), (len(faces), len(faces)))
    body = scipy.sparse.csgraph.connected_components(touching, directed=False)[1]
    return bool((np.bincount(body, tetrahedra(vertices, faces)) > 0.0).all())
