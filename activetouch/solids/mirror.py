"""Whether a solid is its own mirror image, so that images of its touches may be mirrored."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from activetouch.solids.conical import Cone, Cylinder, Frustum
from activetouch.solids.cut import Cut, Union
from activetouch.solids.round import Capsule, Dome, Ellipsoid, Sphere
from activetouch.solids.solid import Floats, Shape, corners
from activetouch.solids.straight import Box, Prism, Wedge
from activetouch.solids.torus import Torus

_SYMMETRIC = (Box, Capsule, Cone, Cylinder, Dome, Ellipsoid, Frustum, Prism, Sphere, Torus, Wedge)
_DIGITS = 9  # of corners [m]


def is_own_mirror_image(shape: Shape) -> bool:
    """Whether a solid is known to be its own mirror image, up to a rotation.

    Cuts and unions are if one of the 24 reflections of a cube keeps them. Of meshes and of solids of other
    classes it is not known.

    >>> cube = Box((1.0, 1.0, 1.0))
    >>> is_own_mirror_image(cube), is_own_mirror_image(Cut(cube, ((1.0, 2.0, 3.0, 1.0),)))
    (True, False)
    """
    return type(shape) in _SYMMETRIC or any(_is_kept(shape, reflection) for reflection in symmetries_of_a_cube(-1.0))


def _is_kept(shape: Shape, reflection: Floats) -> bool:
    """Whether a reflection keeps a solid."""
    if isinstance(shape, Union):
        return all(_is_kept(part, reflection) for part in shape.parts)
    if type(shape) not in (Cut, *_SYMMETRIC):
        return False
    found = corners(shape.geom)
    return np.array_equal(_sorted(found), _sorted(found @ reflection))


def _sorted(points: Floats) -> Floats:
    """Points ``(n, 3)`` in an order that depends on their places only, rounded."""
    return np.unique(np.round(points, _DIGITS) + 0.0, axis=0)  # no -0


def symmetries_of_a_cube(determinant: float) -> Floats:
    """The 24 rotations of a cube onto itself (determinant 1), or its 24 reflections (-1), ``(24, 3, 3)``."""
    found = np.array(
        [np.diag(signs)[list(order)] for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)]
    )
    return np.asarray(found[np.linalg.det(found) * determinant > 0.0])
