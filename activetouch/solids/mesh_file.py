"""Reading of mesh files, and repair of their triangles."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import trimesh

from activetouch.errors import BadMesh
from activetouch.solids.solid import Floats
from activetouch.solids.triangles import Ints, edges, tetrahedra

_FORMATS = (".stl", ".obj", ".ply", ".off")
_SAME_POINT = 1e-8  # [m]; STL repeats corners in every triangle, with seven digits


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
    vertices, faces = _welded(*_read(path), scale)
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


def _read(path: Path) -> tuple[Floats, Ints]:
    kind = path.suffix.lower()
    if not path.exists():
        raise FileNotFoundError(f"there is no mesh file {path}; relative paths start from {Path.cwd()}")
    if kind not in _FORMATS:
        raise BadMesh(f"{path}: meshes are read from {', '.join(_FORMATS)} files")
    try:
        content = io.BytesIO(path.read_bytes())  # without a name, so that no other file is opened
        mesh = trimesh.load_mesh(content, file_type=kind[1:], process=False, skip_materials=True)
        return np.array(mesh.vertices, dtype=float), np.array(mesh.faces, dtype=np.intp)
    except Exception as error:  # parsers raise many kinds of errors
        # If the content is no text, trimesh tries to import a package that guesses encodings.
        reason = "neither text nor a complete binary file" if isinstance(error, ImportError) else error
        raise BadMesh(f"{path.name}: cannot be read as {kind[1:].upper()} ({reason})") from error


def _welded(vertices: Floats, faces: Ints, scale: float) -> tuple[Floats, Ints]:
    """The triangles in metres, with equal corners merged, and without degenerate triangles."""
    vertices = vertices.reshape(-1, 3) * scale
    _, first, same = np.unique(np.round(vertices / _SAME_POINT), axis=0, return_index=True, return_inverse=True)
    faces = same.ravel()[faces.reshape(-1, 3)]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return vertices[first], faces[distinct]
