"""Triangle meshes as shapes, convex or not."""

from __future__ import annotations

import hashlib
from dataclasses import InitVar, dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy  # whose parts load at first use

from activetouch.errors import BadMesh, MeshWarning, warn_of
from activetouch.solids.examination import examined
from activetouch.solids.raster import Surface
from activetouch.solids.sizes import size_problem
from activetouch.solids.solid import Floats, Geom, Ints
from activetouch.solids.triangles import is_convex
from belief.errors import InvalidArgument

_VAST = 1e100  # squares of longer lengths may not be finite [m]


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """A solid bounded by triangles, convex or not, of one body or of several.

    A touch feels the first surface that is met from outside: that of the union of all bodies. Triangles are turned to
    face outwards, cavities are never felt, and holes are allowed as long as few rays from outside reach the inside.
    Meshes are equal if their triangles are equal to the nanometre; names do not matter. MuJoCo collides with the convex
    hull, of a hollow mesh with that of what lies in front of the pad.

    Args:
        centred: whether to move the centre of mass to the origin. See :func:`examination.examined` for where it is if
            there are several bodies or holes.
        remarks: what :meth:`from_file` has to say beside the warnings below; None for other callers.
        scale: metres per unit of the file that the vertices are from, for the message about a size.

    Attributes:
        name: for messages, such as the name of the file.
        vertices: ``(v, 3)`` [m]; unused vertices are removed.
        faces: corners of the triangles as indices of vertices, counter-clockwise from outside, ``(f, 3)``.
        unit: the ``scale`` with which it was read.

    Raises:
        BadMesh: there is no triangle, a vertex is not finite, the surface is flat or encloses no volume, more than 10 %
            of the rays from outside first meet the inside, or the size is outside 0.5 mm to 300 mm.

    Warns:
        MeshWarning: there are several bodies, open edges, or edges of more than two triangles.
    """

    name: str
    vertices: Floats
    faces: Ints
    centred: InitVar[bool] = False
    remarks: InitVar[tuple[str, ...] | None] = None
    scale: InitVar[float] = 1.0
    unit: float = field(init=False, default=1.0)

    def __post_init__(self, centred: bool, remarks: tuple[str, ...] | None, scale: float) -> None:
        object.__setattr__(self, "unit", scale)
        vertices = np.asarray(self.vertices, dtype=float).reshape(-1, 3)
        faces = np.asarray(self.faces, dtype=np.intp).reshape(-1, 3)
        if len(faces) == 0:
            raise BadMesh(f"{self.name}: there are no triangles")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise BadMesh(f"{self.name}: a triangle has a vertex that is not among the {len(vertices)} vertices")
        used, renamed = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], renamed.reshape(-1, 3)
        if not np.abs(vertices).max() < _VAST:
            raise BadMesh(f"{self.name}: some vertices are not finite numbers")
        surface = examined(vertices, faces)
        if surface.problem:
            raise BadMesh(f"{self.name}: {surface.problem}")
        object.__setattr__(self, "vertices", vertices - surface.centre if centred else vertices)
        object.__setattr__(self, "faces", surface.faces)
        if problem := size_problem(self.name, self.bounding_radius, scale):
            raise BadMesh(f"{self.name}: {problem}")
        if words := (*(remarks or ()), *surface.remarks):
            warn_of(f"{self.name}: {'; '.join(words)}", MeshWarning)

    @classmethod
    def from_file(cls, path: Path | str, scale: float | None = None) -> Mesh:
        """The mesh in an STL, OBJ, PLY, OFF or MSH file, with its centre of mass moved to the origin.

        With the extra ``meshes`` also in a GLB, glTF, DAE or 3MF file.

        Corners within 10 nm of each other are merged. Files of several parts are read as one mesh.

        Args:
            path: the file. Of files that it refers to, only buffers of glTF below its own folder are opened.
            scale: metres per unit of the file; 0.001 for a file in millimetres. By default 1, or what a DAE or 3MF
                file states; an object of 15 to 300 m
                about its middle is taken to be in millimetres, with a warning.

        Raises:
            FileNotFoundError: the file does not exist.
            BadMesh: the path is no regular file of up to 256 MiB, the file cannot be read, or its contents are not a
                solid; the message names the line of a text.
            InvalidArgument: the scale is not positive and finite.

        Warns:
            MeshWarning: the unit was guessed, the size is unusual, there are more than 50 000 triangles, or see
                :class:`Mesh`.
        """
        from activetouch.solids.mesh_file import read_surface

        if scale is not None and not 0.0 < scale < np.inf:
            raise InvalidArgument(f"scale must be positive and finite, got {scale}")
        vertices, faces, remarks, used = read_surface(Path(path), scale)
        return cls(Path(path).name, vertices, faces, centred=True, remarks=remarks, scale=used)

    @cached_property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @cached_property
    def geom(self) -> Geom:
        """The corners of the convex hull. See :class:`Shape`."""
        corners = self.vertices[scipy.spatial.ConvexHull(self.vertices).vertices]
        return Geom("mesh", vertices=corners, presses="solid" if is_convex(self.vertices, self.faces) else "surface")

    @cached_property
    def surface(self) -> Surface:
        """The triangles, prepared for height maps."""
        return Surface.of(self.vertices, self.faces)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the triangles, with vertices rounded to the nanometre."""
        content = np.round(self.vertices * 1e9).astype("<i8").tobytes(), self.faces.astype("<i8").tobytes()
        return hashlib.sha256(b"".join(content)).hexdigest()

    def __eq__(self, other: object) -> bool:
        return self.digest == other.digest if isinstance(other, Mesh) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        return f"Mesh({self.name!r}, {len(self.faces)} triangles, sha256 {self.digest[:12]})"
