"""Tables of shapes: solids by their triangles, which touches feel, with a collision geom for MuJoCo.

To add a shape, add an entry to a table: a solid of another size, a mesh
(``SHAPES | {"mug": Mesh.from_file("mug.stl", scale=0.001)}``), a :class:`Family` of solids that differ in their
proportions, or an object of your own class with the members of :class:`Shape`, whose surface is
:meth:`activetouch.solids.raster.Surface.of` its triangles. K, labels, planners and reports follow
from the table of the scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import scipy  # whose parts load at first use

from activetouch.errors import BadMesh
from activetouch.solids.family import Family
from activetouch.solids.primitives import (
    Box,
    Capsule,
    Cone,
    Cut,
    Cylinder,
    Dome,
    Ellipsoid,
    Frustum,
    Prism,
    Solid,
    Sphere,
    Torus,
    Union,
    Wedge,
)
from activetouch.solids.solid import Geom, Shape
from belief.naming import later

if TYPE_CHECKING:
    from activetouch.solids.mesh import Mesh

__all__ = [
    "EXTENDED_SHAPES",
    "KEYED_SHAPES",
    "SHAPES",
    "BadMesh",
    "Box",
    "Capsule",
    "Cone",
    "Cut",
    "Cylinder",
    "Dome",
    "Ellipsoid",
    "Family",
    "Frustum",
    "Geom",
    "Mesh",
    "Prism",
    "Shape",
    "Sphere",
    "Torus",
    "Union",
    "Wedge",
]

SHAPES: Mapping[str, Shape] = MappingProxyType(
    {
        "sphere": Sphere(0.020),
        "cube": Box((0.016, 0.016, 0.016)),
        "cylinder": Cylinder(radius=0.016, half_length=0.020),
        "cone": Cone(radius=0.018, height=0.036),
    }
)
"""The paper's four shapes at nominal size (decision 0003)."""

EXTENDED_SHAPES: Mapping[str, Shape] = MappingProxyType(
    {
        **SHAPES,
        "cuboid": Box((0.016, 0.016, 0.024)),
        "wedge": Wedge(length=0.032, height=0.032, half_width=0.016),
        "frustum": Frustum(bottom_radius=0.018, top_radius=0.008, height=0.020),
        "capsule": Capsule(radius=0.016, half_length=0.012),
        "half_sphere": Dome(0.020),
        "hexagonal_prism": Prism(num_sides=6, radius=0.0185, half_length=0.020),
        "ellipsoid": Ellipsoid((0.016, 0.020, 0.024)),
        "torus": Torus(ring_radius=0.016, tube_radius=0.007),
    }
)
"""Twelve shapes that share faces, edges and curvatures, so that one touch is often ambiguous.

For example, the cuboid has faces of the cube, and the frustum is a truncated cone.
"""

_CUBE, _SHAFT, _PLATE = Box((0.016, 0.016, 0.016)), Cylinder(0.016, 0.020), Box((0.016, 0.016, 0.006))

KEYED_SHAPES: Mapping[str, Shape] = MappingProxyType(
    {
        "cube": _CUBE,
        "cube_cut": Cut(_CUBE, ((1.0, 1.0, 1.0, 0.022),)),
        "cube_cut_twice": Cut(_CUBE, ((1.0, 1.0, 1.0, 0.022), (-1.0, -1.0, -1.0, 0.022))),
        "cube_chamfered": Cut(_CUBE, ((1.0, 1.0, 0.0, 0.017),)),
        "shaft": _SHAFT,
        "shaft_flat": Cut(_SHAFT, ((1.0, 0.0, 0.0, 0.013),)),
        "plate": _PLATE,
        "plate_boss": Union((_PLATE, Box((0.006, 0.006, 0.012)))),
    }
)
"""Three families of shapes that differ in one place, as keys, connectors and shafts do."""

_SAME = 1e-8  # distance of corners that are one [m]


def is_own_mirror_image(shape: Shape) -> bool:
    """Whether a solid is its own mirror image by one of the 24 reflections of a cube, so that touches may be mirrored.

    Of meshes and of solids of other classes it is not known.

    >>> cube = Box((1.0, 1.0, 1.0))
    >>> is_own_mirror_image(cube), is_own_mirror_image(Cut(cube, ((1.0, 2.0, 3.0, 1.0),)))
    (True, False)
    """
    if not isinstance(shape, Solid):
        return False
    corners = shape.surface.vertices.T
    tree, turns = scipy.spatial.cKDTree(corners), scipy.spatial.transform.Rotation.create_group("O").as_matrix()
    return any(np.max(tree.query(corners @ -turn)[0]) < _SAME for turn in np.rint(turns))


__getattr__, __dir__ = later(__name__)
