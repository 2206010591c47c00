"""Where an object is when it is pressed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from activetouch.poses import Quaternion
from activetouch.shapes import Shape


@dataclass(frozen=True, eq=False)
class Placement:
    """An object in front of the pad, ready to be pressed.

    Attributes:
        shape: its shape at nominal size.
        scale: its size factor.
        orientation: unit quaternion, object to pad frame, ``wxyz``.
        offset: displacement of its centre from the approach axis, along y and z [m], ``(2,)``.
    """

    shape: Shape
    scale: float
    orientation: Quaternion
    offset: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))

    @property
    def bounding_radius(self) -> float:
        """Radius of the smallest ball about its centre that holds it [m]."""
        return self.shape.bounding_radius * self.scale
