"""Reading of mesh files: triangles in metres, with equal corners merged, of an ordinary number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy  # whose parts load at first use

from activetouch.errors import BadMesh
from activetouch.solids.mesh_formats import read_obj, read_ply, read_stl
from activetouch.solids.solid import Floats, Ints
from belief.files import require_regular_file

_READERS = {".stl": read_stl, ".obj": read_obj, ".ply": read_ply}
ENDINGS = tuple(_READERS)
"""Of the files that can be read."""
_MOST_BYTES = 256 * 2**20
_MOST_PAIRS = 10_000_000
_MANY = 50_000  # triangles from which a view takes more than 15 ms
_SAME_POINT = 1e-8  # distance [m]; STL repeats corners in every triangle, with seven digits
_MILLIMETRES = (15.0, 150.0)  # radii for which no other usual unit gives an object of less than 150 mm


@np.errstate(over="ignore", invalid="ignore")  # such vertices are rejected later
def read_surface(path: Path, scale: float | None) -> tuple[Floats, Ints, tuple[str, ...]]:
    """Vertices in metres, ``(v, 3)``, triangles, ``(f, 3)``, and what was guessed or is unusual, as texts.

    Args:
        path: the file.
        scale: metres per unit of the file; that of the size by default, see :meth:`Mesh.from_file`.

    Raises:
        FileNotFoundError: the file does not exist.
        BadMesh: the file cannot be read, or is of an impossible size.
    """
    kind = path.suffix.lower()
    if not path.exists():
        raise FileNotFoundError(f"there is no mesh file {path}; relative paths start from {Path.cwd()}")
    if kind not in ENDINGS:
        raise BadMesh(f"{path}: meshes are read from {', '.join(ENDINGS)} files; the library trimesh converts others")
    require_regular_file(path, BadMesh)
    try:
        if (size := path.stat().st_size) > _MOST_BYTES:
            raise ValueError(f"it has {size} bytes, {_MOST_BYTES} are the most; simplify it")
        vertices, faces = _READERS[kind](path.read_bytes())
    except (OSError, ValueError, OverflowError) as error:
        raise BadMesh(f"{path.name}: cannot be read as {kind[1:].upper()}: {error}") from error
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    if not (len(used) and np.isfinite(np.square(np.ptp(vertices, axis=0)).sum())):
        return vertices, faces, ()  # rejected later
    scale, remarks = _scale(path, vertices, scale)
    vertices, faces = _welded(path.name, vertices * scale, faces)
    if len(faces) > _MANY:
        remarks = (*remarks, f"{len(faces)} triangles make touches slow; a program for meshes reduces them")
    return vertices, faces, remarks


def _scale(path: Path, vertices: Floats, given: float | None) -> tuple[float, tuple[str, ...]]:
    """Metres per unit: what is given, or 1, unless only millimetres make an object that a pad may press; and why."""
    extent = np.ptp(vertices, axis=0)
    if given is not None or not _MILLIMETRES[0] < np.linalg.norm(extent) / 2 < _MILLIMETRES[1]:
        return 1.0 if given is None else given, ()
    size = " × ".join(f"{length:.3g}" for length in extent)
    return 0.001, (
        f"read in millimetres ({size} mm), because an object of {extent.max():.3g} m is too large for a pad; write "
        f"{path.name}@0.001 to say so",
    )


def _welded(name: str, vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """The triangles with equal corners merged, without degenerate triangles and without repeated ones."""
    kept, same = _merged(name, vertices)
    vertices, faces = vertices[kept], same[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    order = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
    first, _ = _distinct(np.take_along_axis(faces, order, axis=1))
    return vertices, faces[np.sort(first)]


def _distinct(rows: Floats | Ints) -> tuple[Ints, Ints]:
    """The first of each group of equal rows, in the order of their numbers, and the group of each row, ``(n,)``.

    It is that of :func:`numpy.unique` with ``axis=0``, and takes a fifth of the time.
    """
    order = np.lexsort(rows.T[::-1])
    is_new = np.append(True, (rows[order[1:]] != rows[order[:-1]]).any(axis=1))[: len(rows)]
    group = np.empty(len(rows), np.intp)
    group[order] = np.cumsum(is_new) - 1
    return order[is_new], group


def _merged(name: str, points: Floats) -> tuple[Ints, Ints]:
    """The first point of each group of neighbours, ``(g,)``, and the group of each point, ``(n,)``."""
    first, same = _distinct(points)
    tree, size = scipy.spatial.cKDTree(points[first]), len(first)
    if (num_pairs := (tree.count_neighbors(tree, _SAME_POINT) - size) // 2) > _MOST_PAIRS:
        raise BadMesh(
            f"{name}: {num_pairs} pairs of corners are within {_SAME_POINT} m of each other; is the scale right?"
        )
    pairs = tree.query_pairs(_SAME_POINT, output_type="ndarray")
    links = scipy.sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (size, size))
    num_groups, group = scipy.sparse.csgraph.connected_components(links, directed=False)
    kept = np.full(num_groups, len(points))
    np.minimum.at(kept, group, first)
    order = np.lexsort(np.round(points[kept] / _SAME_POINT).T[::-1])
    return kept[order], np.argsort(order)[group[same]]
