"""Pictures of bodies from their meshes, shaded height maps without OpenGL."""

from __future__ import annotations

import numpy as np

from activetouch.poses import multiply, turn
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.solids.solid import Shape
from belief.validation import Floats

_CAMERA = multiply(turn("y", np.deg2rad(-25.0)), turn("z", np.deg2rad(35.0)))  # on the side of the pad, and above
_LIGHT = np.array([0.75, -0.35, 0.55])


def portrait(solid: Shape, orientation: Floats, reach: float, pixels: int = 96) -> Floats:
    """A picture of a body, ``(pixels, pixels)`` in [0, 1], row 0 at the bottom; NaN beside the body.

    Args:
        solid: the body.
        orientation: how it lies, unit quaternion ``wxyz``.
        reach: half of the picture's width [m].
        pixels: width and height of the picture.
    """
    window = Window(2.1 * reach, pixels)
    heights = predicted_contacts(solid, multiply(_CAMERA, orientation)[None], (0.0, 0.0), window)[0]
    hit = np.isfinite(heights)
    filled = np.where(hit, heights, -reach)
    slopes = np.gradient(filled, window.edge / pixels)
    normals = np.stack([np.ones_like(filled), -slopes[1], -slopes[0]], axis=-1)
    light = np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)) / np.linalg.norm(normals, axis=-1), 0.0, 1.0)
    return np.where(hit, 0.2 + 0.8 * light, np.nan)
