"""Reading of mesh files, and repair of their triangles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy  # whose parts load at first use
import trimesh

from activetouch.errors import BadMesh
from activetouch.solids.mesh_formats import read_obj, read_off, read_stl
from activetouch.solids.mesh_ply import read_ply
from activetouch.solids.solid import Floats
from activetouch.solids.triangles import Ints, edges, tetrahedra
from belief.files import require_regular_file

_FORMATS = {".stl": read_stl, ".obj": read_obj, ".ply": read_ply, ".off": read_off}
_MOST_BYTES, _MOST_PAIRS = 256 * 2**20, 10_000_000
_SAME_POINT = 1e-8  # distance [m]; STL repeats corners in every triangle, with seven digits


@np.errstate(over="ignore", invalid="ignore")  # such vertices are rejected later
def read_surface(path: Path, scale: float) -> tuple[Floats, Ints]:
    """Vertices in metres about the centre of mass, ``(v, 3)``, and triangles that face outwards, ``(f, 3)``.

    Args:
        path: the file.
        scale: metres per unit of the file.

    Raises:
        FileNotFoundError: the file does not exist.
        BadMesh: the file cannot be read.
    """
    vertices, faces = _read(path, scale)
    if len(faces) == 0:
        return vertices, faces
    directed, sharing = edges(faces)
    if (sharing == 2).all() and len(np.unique(directed)) < len(directed):
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        trimesh.repair.fix_winding(mesh)
        faces = np.asarray(mesh.faces, dtype=np.intp)
    vertices = vertices - vertices.mean(axis=0)  # for accuracy far from the origin
    volumes = tetrahedra(vertices, faces)
    volume = volumes.sum()
    if volume < 0.0:
        faces = faces[:, ::-1]
    if volume != 0.0:
        vertices = vertices - volumes @ vertices[faces].sum(axis=1) / (4 * volume)
    return vertices, faces


def _read(path: Path, scale: float) -> tuple[Floats, Ints]:
    kind = path.suffix.lower()
    if not path.exists():
        raise FileNotFoundError(f"there is no mesh file {path}; relative paths start from {Path.cwd()}")
    if kind not in _FORMATS:
        raise BadMesh(f"{path}: meshes are read from {', '.join(_FORMATS)} files")
    require_regular_file(path, BadMesh)
    try:
        if (size := path.stat().st_size) > _MOST_BYTES:
            raise ValueError(f"it has {size} bytes, {_MOST_BYTES} are the most; simplify it")
        return _welded(*_FORMATS[kind](path.read_bytes()), scale)
    except (OSError, ValueError) as error:
        raise BadMesh(f"{path.name}: cannot be read as {kind[1:].upper()}: {error}") from error


def _welded(vertices: Floats, faces: Ints, scale: float) -> tuple[Floats, Ints]:
    """The triangles in metres, with equal corners merged, and without degenerate triangles."""
    used, faces = np.unique(faces, return_inverse=True)
    vertices = vertices[used] * scale
    if len(used) and np.isfinite(np.square(np.ptp(vertices, axis=0)).sum()):  # others are rejected later
        kept, same = _merged(vertices)
        vertices, faces = vertices[kept], same[faces.ravel()]
    faces = faces.reshape(-1, 3)
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return vertices, faces[distinct]


def _merged(points: Floats) -> tuple[Ints, Ints]:
    """The first point of each group of neighbours, ``(g,)``, and the group of each point, ``(n,)``."""
    distinct, first, same = np.unique(points, axis=0, return_index=True, return_inverse=True)
    tree, size = scipy.spatial.cKDTree(distinct), len(distinct)
    if (num_pairs := (tree.count_neighbors(tree, _SAME_POINT) - size) // 2) > _MOST_PAIRS:
        raise ValueError(f"{num_pairs} pairs of corners are within {_SAME_POINT} m of each other; is the scale right?")
    pairs = tree.query_pairs(_SAME_POINT, output_type="ndarray")
    links = scipy.sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (size, size))
    num_groups, group = scipy.sparse.csgraph.connected_components(links, directed=False)
    kept = np.full(num_groups, len(points))
    np.minimum.at(kept, group, first)
    order = np.lexsort(np.round(points[kept] / _SAME_POINT).T[::-1])
    return kept[order], np.argsort(order)[group[same.ravel()]]
