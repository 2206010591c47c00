"""Fewer triangles for the same surface: vertices in one cell of a grid become one, where its planes meet.

The vertex of a cell minimises the squared distances to the planes of all its triangles (Lindstrom, "Out-of-core
simplification of large polygonal models", 2000), so that edges and corners stay sharp. The error is measured, not
estimated, from vertices, centres and edges of each surface to the other, so that slots of twice its width stay open.
"""

from __future__ import annotations

import numpy as np
import scipy  # whose parts load at first use

from activetouch.solids.solid import Floats, Ints
from activetouch.solids.triangles import normals

LARGEST_ERROR = 1e-4
"""Distance that no measured point of the original or of the reduced surface may have from the other [m]."""

_SMALLEST = 1e-3  # eigenvalues of the planes of a cell below this, relative to the largest, count as zero
_FINER, _MOST_SIZES = 0.75, 32  # from one size of cells to the next; how many sizes are tried
_FINEST, _COARSEST = 1e-4, 1.0  # cells, relative to the longest extent, and [m]
_MEASURED = 30_000  # vertices, triangles and edges of a surface from which distances are measured, evenly among all
_WORTH = 0.7  # share of the triangles below which a reduction is worth its error
_NEAREST = 12  # triangles that are asked for their distance from a vertex


def reduced(vertices: Floats, faces: Ints, most: int) -> tuple[Floats, Ints, float]:
    """A surface of about ``most`` triangles, or of as many more as the largest error needs.

    Args:
        vertices: ``(v, 3)`` [m].
        faces: ``(f, 3)``.
        most: wanted number of triangles.

    Returns:
        Vertices, faces, and the largest distance [m] of a measured point of either surface from the other: their
        vertices, centres of triangles and middles of edges, of each up to 30 000. The original and 0 if nothing much
        smaller is near enough.
    """
    across = normals(vertices, faces)
    cell = float(np.sqrt(np.linalg.norm(across, axis=1).sum() / most))  # a plane has two triangles in each cell
    cells = cell * _FINER ** np.arange(_MOST_SIZES)
    for cell in cells[(cells > _FINEST * np.ptp(vertices, axis=0).max()) & (cells < _COARSEST)]:
        new_vertices, new_faces = _clustered(vertices, faces, across, cell)
        if len(new_faces) > _WORTH * len(faces):
            break
        if len(new_faces):
            error = _largest_distance(vertices, faces, new_vertices, new_faces)
            if error <= LARGEST_ERROR:
                error = max(error, _largest_distance(new_vertices, new_faces, vertices, faces))
            if error <= LARGEST_ERROR:
                return new_vertices, new_faces, error
    return vertices, faces, 0.0


def _clustered(vertices: Floats, faces: Ints, across: Floats, cell: float) -> tuple[Floats, Ints]:
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
        height = np.einsum("fi,fi->f", across, vertices[faces[:, 0]] - mean[corners])
        for i in range(3):
            shift[:, i] += np.bincount(corners, across[:, i] * height, minlength=len(num))
            for j in range(i, 3):
                quadric[:, i, j] += np.bincount(corners, across[:, i] * across[:, j], minlength=len(num))
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


def _largest_distance(vertices: Floats, faces: Ints, to_vertices: Floats, to_faces: Ints) -> float:
    """Largest distance of points of a surface from the triangles of another that are nearest by their centres [m]."""
    some = vertices[faces[:: -(-len(faces) // _MEASURED)]]
    middles = (some + np.roll(some, -1, axis=1)).reshape(-1, 3)[:: -(-3 * len(some) // _MEASURED)] / 2
    points = np.concatenate([vertices[:: -(-len(vertices) // _MEASURED)], some.mean(axis=1), middles])
    corners = to_vertices[to_faces]
    num = min(_NEAREST, len(corners))
    _, near = scipy.spatial.cKDTree(corners.mean(axis=1)).query(points, k=np.arange(1, num + 1))
    found = _distances(np.repeat(points, num, axis=0), corners[near.ravel()])
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
