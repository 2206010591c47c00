"""Tables of shapes: solids with exact ray geometry and a collision geom for MuJoCo.

The touch image needs, for every taxel, the distance at which a ray along the pad's normal enters the solid. All solids
compute it in closed form or to rounding.

To add a shape, add an entry to a table: a solid of another size, a mesh
(``SHAPES | {"mug": Mesh.from_file("mug.stl", scale=0.001)}``), a :class:`Family` of solids that differ in their
proportions, or an object of your own class with the members of :class:`Shape`. K, labels, planners and reports follow
from the table of the scene.

    >>> import numpy as np
    >>> sphere = SHAPES["sphere"]
    >>> sphere.entry_distance(np.array([[-0.05], [0.0], [0.0]]), np.array([1.0, 0.0, 0.0]))
    array([0.03])
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import scipy  # whose parts load at first use

from activetouch.errors import BadMesh
from activetouch.solids.family import Family
from activetouch.solids.mesh import Mesh
from activetouch.solids.round import Capsule, Cone, Cylinder, Dome, Ellipsoid, Frustum, Sphere, Torus
from activetouch.solids.solid import Floats, Geom, Shape, corners
from activetouch.solids.straight import Box, Cut, Prism, Union, Wedge

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

_SYMMETRIC = (Box, Capsule, Cone, Cylinder, Dome, Ellipsoid, Frustum, Prism, Sphere, Torus, Wedge)
_DIGITS = 9  # of corners [m]


def is_own_mirror_image(shape: Shape) -> bool:
    """Whether a solid is known to be its own mirror image, up to a rotation, so that its touches may be mirrored.

    Cuts and unions are if one of the 24 reflections of a cube keeps them. Of meshes and of solids of other
    classes it is not known.

    >>> cube = Box((1.0, 1.0, 1.0))
    >>> is_own_mirror_image(cube), is_own_mirror_image(Cut(cube, ((1.0, 2.0, 3.0, 1.0),)))
    (True, False)
    """
    if type(shape) in _SYMMETRIC:
        return True
    turns = np.rint(scipy.spatial.transform.Rotation.create_group("O").as_matrix())
    return any(_is_kept(shape, -turn) for turn in turns)


def _is_kept(shape: Shape, reflection: Floats) -> bool:
    """Whether a reflection keeps a solid."""
    if isinstance(shape, Union):
        return all(_is_kept(part, reflection) for part in shape.parts)
    if type(shape) not in (Cut, *_SYMMETRIC):
        return False
    found = corners(shape.geom)
    here, there = (
        np.unique(np.round(points, _DIGITS) + 0.0, axis=0) for points in (found, found @ reflection)
    )  # no -0
    return np.array_equal(here, there)
