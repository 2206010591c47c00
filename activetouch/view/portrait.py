"""Pictures of bodies from their geometry, shaded height maps without OpenGL."""

from __future__ import annotations

import numpy as np

from activetouch.poses import multiply, turn, turned
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.solids.solid import Shape
from belief.validation import Floats

_CAMERA = multiply(turn("y", np.deg2rad(-25.0)), turn("z", np.deg2rad(35.0)))  # on the side of the pad, and above
_LIGHT = np.array([0.75, -0.35, 0.55])


def portraits(
    solid: Shape, orientations: Floats, reach: float, pixels: int = 96, sizes: Floats | float = 1.0
) -> Floats:
    """Pictures of a body, ``(n, pixels, pixels)`` in [0, 1], row 0 at the bottom; NaN beside the body.

    ``orientations (n, 4)`` are unit quaternions ``wxyz``, ``reach`` is half of a picture's width [m], and ``sizes`` are
    factors, ``(n,)`` or one number.
    """
    window = Window(2.1 * reach, pixels)
    heights = predicted_contacts(solid, turned(_CAMERA, orientations), (0.0, 0.0), window, sizes)
    hit = np.isfinite(heights)
    filled = np.where(hit, heights, -reach)
    upwards, across = np.gradient(filled, window.edge / pixels, axis=(1, 2))
    normals = np.stack([np.ones_like(filled), -across, -upwards], axis=-1)
    light = np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)) / np.linalg.norm(normals, axis=-1), 0.0, 1.0)
    return np.where(hit, 0.2 + 0.8 * light, np.nan)
