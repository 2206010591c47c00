"""Edges and volumes of a surface of triangles."""

from __future__ import annotations

import numpy as np
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


def tetrahedra(vertices: Floats, faces: Ints) -> Floats:
    """Signed volumes of the tetrahedra between the origin and each triangle, ``(f,)`` [m³]."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.einsum("fi,fi->f", a, np.cross(b, c)) / 6
