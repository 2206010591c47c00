"""Fewer triangles for the same surface: vertices in one cell of a grid become one, where its planes meet.

The vertex of a cell minimises the squared distances to the planes of all its triangles (Lindstrom, "Out-of-core
simplification of large polygonal models", 2000), so that edges and corners stay sharp. What is thinner than a cell may
close or vanish. The error is measured, not estimated.
"""

from __future__ import annotations

import numpy as np
import scipy  # whose parts load at first use

from activetouch.solids.solid import Floats
from activetouch.solids.triangles import Ints

LARGEST_ERROR = 1e-4
"""Distance that none of the measured vertices of the original may have from the reduced surface [m]."""
NUM_MEASURED = 100_000
"""Number of vertices whose distance is measured, evenly among all."""

_SMALLEST = 1e-3  # eigenvalues of the planes of a cell below this, relative to the largest, count as zero
_FINER = 0.75  # from one size of cells to the next
_WORTH = 0.7  # share of the triangles below which a reduction is worth its error
_NEAREST = 12  # triangles that are asked for their distance from a vertex


def reduced(vertices: Floats, faces: Ints, most: int) -> tuple[Floats, Ints, float]:
    """A surface of about ``most`` triangles, or of as many more as the largest error needs.

    Args:
        vertices: ``(v, 3)`` [m].
        faces: ``(f, 3)``.
        most: wanted number of triangles.

    Returns:
        Vertices, faces, and the largest distance of an original vertex from them [m]. The original and 0 if nothing
        much smaller is near enough.
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    cell = float(np.sqrt(np.linalg.norm(normals, axis=1).sum() / most))  # a plane has two triangles in each cell
    measured = vertices[:: -(-len(vertices) // NUM_MEASURED)]
    while True:
        new_vertices, new_faces = _clustered(vertices, faces, normals, cell)
        if len(new_faces) > _WORTH * len(faces):
            return vertices, faces, 0.0
        if len(new_faces):
            error = _largest_distance(measured, new_vertices, new_faces)
            if error <= LARGEST_ERROR:
                return new_vertices, new_faces, error
        cell *= _FINER


def _clustered(vertices: Floats, faces: Ints, normals: Floats, cell: float) -> tuple[Floats, Ints]:
    """Vertices of the cells that have any, and triangles between different cells."""
    place = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    size = place.max(axis=0) + 1
    _, group, num = np.unique(
        (place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2], return_inverse=True, return_counts=True
    )
    mean = np.column_stack([np.bincount(group, vertices[:, axis]) for axis in range(3)]) / num[:, None]
    corner = group[faces]
    quadric, shift = np.zeros((len(num), 3, 3)), np.zeros((len(num), 3))
    for corners in corner.T:  # each triangle counts in the cells of its corners, as seen from their means
        height = np.einsum("fi,fi->f", normals, vertices[faces[:, 0]] - mean[corners])
        for i in range(3):
            shift[:, i] += np.bincount(corners, normals[:, i] * height, minlength=len(num))
            for j in range(i, 3):
                quadric[:, i, j] += np.bincount(corners, normals[:, i] * normals[:, j], minlength=len(num))
    values, axes = np.linalg.eigh(quadric, UPLO="U")
    usable = values > _SMALLEST * values[:, -1:]
    along = np.einsum("nij,ni->nj", axes, shift)
    step = np.einsum("nij,nj->ni", axes, np.where(usable, along / np.where(usable, values, 1.0), 0.0))
    moved = mean + np.clip(step, -cell, cell)
    kept = corner[(corner != np.roll(corner, 1, axis=1)).all(axis=1)]
    order = (np.argmin(kept, axis=1)[:, None] + np.arange(3)) % 3
    kept = np.take_along_axis(kept, order, axis=1)
    _, first = np.unique(kept @ np.array([len(num) ** 2, len(num), 1]), return_index=True)
    return moved, kept[np.sort(first)]


def _largest_distance(vertices: Floats, new_vertices: Floats, new_faces: Ints) -> float:
    """Largest distance of the vertices from the triangles that are nearest to them by their centres [m]."""
    corners = new_vertices[new_faces]
    num = min(_NEAREST, len(corners))
    _, near = scipy.spatial.cKDTree(corners.mean(axis=1)).query(vertices, k=np.arange(1, num + 1))
    found = _distances(np.repeat(vertices, num, axis=0), corners[near.ravel()])
    return float(found.reshape(-1, num).min(axis=1).max())


def _distances(points: Floats, triangles: Floats) -> Floats:
    """Distance of each point ``(n, 3)`` from its triangle ``(n, 3, 3)``, ``(n,)``."""
    found = np.full(len(points), np.inf)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        along = triangles[:, end] - triangles[:, start]
        offset = points - triangles[:, start]
        length = np.einsum("ni,ni->n", along, along)
        at = np.clip(np.einsum("ni,ni->n", offset, along) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(offset - at[:, None] * along, axis=1))
    u, v, w = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0], points - triangles[:, 0]
    normal = np.cross(u, v)
    area = np.einsum("ni,ni->n", normal, normal)
    inverse = 1.0 / np.where(area > 0.0, area, np.inf)
    beta, gamma = (np.einsum("ni,ni->n", normal, np.cross(*pair)) * inverse for pair in ((w, v), (u, w)))
    inside = (beta >= 0.0) & (gamma >= 0.0) & (beta + gamma <= 1.0) & (area > 0.0)
    height = np.abs(np.einsum("ni,ni->n", normal, w)) * np.sqrt(inverse)
    return np.where(inside, np.minimum(found, height), found)
