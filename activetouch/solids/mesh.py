"""Closed triangle meshes as shapes, convex or not."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy  # whose parts load at first use

from activetouch.errors import BadMesh
from activetouch.solids.raster import Surface
from activetouch.solids.raycast import first_entry
from activetouch.solids.solid import Floats, Geom
from activetouch.solids.triangles import Ints, edges, tetrahedra

_MIN_RADIUS, _MAX_RADIUS = 0.0005, 0.1  # of the bounding ball of objects for a fingertip-sized pad [m]
_TYPICAL_RADIUS = 0.005  # smallest radius for which an error message suggests a unit [m]
_CONVEX = 1e-6  # relative difference of area and volume from those of the convex hull
_UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254}


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """A connected solid bounded by triangles, convex or not.

    Meshes are equal if their triangles are equal to the nanometre; names do not matter. MuJoCo collides with the convex
    hull, of a hollow mesh with that of what lies in front of the pad. Self-intersections are not checked.

    Attributes:
        name: for messages, such as the name of the file.
        vertices: ``(v, 3)`` [m]; unused vertices are removed.
        faces: corners of the triangles as indices of vertices, counter-clockwise from outside, ``(f, 3)``.

    Raises:
        BadMesh: there is no triangle, a vertex is not finite, the surface is open, inside out or not connected, or the
            size is outside 0.5 mm to 100 mm.
    """

    name: str
    vertices: Floats
    faces: Ints

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, dtype=float).reshape(-1, 3)
        faces = np.asarray(self.faces, dtype=np.intp).reshape(-1, 3)
        if len(faces) == 0:
            raise BadMesh(f"{self.name}: there are no triangles")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise BadMesh(f"{self.name}: a triangle has a vertex that is not among the {len(vertices)} vertices")
        used, renamed = np.unique(faces, return_inverse=True)
        object.__setattr__(self, "vertices", vertices[used])
        object.__setattr__(self, "faces", renamed.reshape(-1, 3))
        if problem := self._surface_problem() or self._size_problem():
            raise BadMesh(f"{self.name}: {problem}")

    @classmethod
    def from_file(cls, path: Path | str, scale: float = 1.0) -> Mesh:
        """The mesh in an STL, OBJ, PLY or OFF file, with its centre of mass moved to the origin.

        Corners within 10 nm of each other are merged, and triangles are oriented consistently.

        Args:
            path: the file. Files that it refers to are not opened.
            scale: metres per unit of the file; 0.001 for a file in millimetres.

        Raises:
            FileNotFoundError: the file does not exist.
            BadMesh: the path is no regular file of up to 256 MiB, the file cannot be read, or its contents are not a
                solid; the message names the line of a text.
            ValueError: the scale is not positive and finite.
        """
        from activetouch.solids.mesh_file import read_surface  # loads trimesh

        if not 0.0 < scale < np.inf:
            raise ValueError(f"scale must be positive and finite, got {scale}")
        return cls(Path(path).name, *read_surface(Path(path), scale))

    @cached_property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @cached_property
    def geom(self) -> Geom:
        """The corners of the convex hull. See :class:`Shape`."""
        hull = scipy.spatial.ConvexHull(self.vertices)
        one, two, three = np.moveaxis(self.vertices[self.faces], 1, 0)
        area = 0.5 * float(np.linalg.norm(np.cross(two - one, three - one), axis=1).sum())
        volume = float(tetrahedra(self.vertices, self.faces).sum())
        is_convex = np.allclose((area, volume), (hull.area, hull.volume), rtol=_CONVEX, atol=0.0)
        return Geom("mesh", vertices=self.vertices[hull.vertices], presses="solid" if is_convex else "surface")

    @cached_property
    def surface(self) -> Surface:
        """The triangles, prepared for height maps."""
        return Surface.of(self.vertices, self.faces)

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        return first_entry(self.vertices, self.faces, origins, direction)

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

    def _surface_problem(self) -> str | None:
        """The reason why the triangles do not bound one solid, if any."""
        if not np.isfinite(self.vertices).all():
            return "some vertices are not finite numbers"
        directed, sharing = edges(self.faces)
        if (sharing != 2).any():
            return (
                f"it is not closed: {(sharing == 1).sum()} open edges, {(sharing > 2).sum()} shared by more than two "
                "triangles. Fill its holes, or make it solid, in the program it comes from"
            )
        if len(np.unique(directed)) < len(directed):
            return "its triangles are not oriented consistently"
        if (num_pieces := self._num_pieces()) > 1:
            return f"it has {num_pieces} separate surfaces; join them into one solid and fill its cavities"
        if tetrahedra(self.vertices, self.faces).sum() <= 0.0:
            return "it encloses no volume, or is inside out"
        return None

    def _num_pieces(self) -> int:
        start, end = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        size = len(self.vertices)
        edges = scipy.sparse.coo_array((np.ones(start.size), (start, end)), (size, size))
        return int(scipy.sparse.csgraph.connected_components(edges)[0])

    def _size_problem(self) -> str | None:
        """The reason why the size is unsuitable, if any, with suggested units."""
        if _MIN_RADIUS <= self.bounding_radius <= _MAX_RADIUS:
            return None
        guesses = [
            f"{scale} if it is in {unit}"
            for unit, scale in _UNITS.items()
            if _TYPICAL_RADIUS <= self.bounding_radius * scale <= _MAX_RADIUS
        ]
        example = next(iter(guesses), "").partition(" ")[0]
        hint = (
            f". Give its scale: {', or '.join(guesses)}; that is --mesh-scale {example} on the command line, "
            f"Mesh.from_file(path, scale={example}) in Python"
            if guesses
            else ""
        )
        return (
            f"its farthest point is {self.bounding_radius:.4g} m from its origin, allowed are {_MIN_RADIUS} m to "
            f"{_MAX_RADIUS} m. Lengths are in metres{hint}"
        )
