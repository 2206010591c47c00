"""Objects and placements: solid, orientation, size and surface of what is pressed, and its position."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from activetouch.poses import Quaternion, require_unit
from activetouch.solids.solid import Shape


@dataclass(frozen=True, eq=False)
class WorldObject:
    """One physical object, as it is for a whole episode.

    Attributes:
        shape_index: index of its shape.
        scale: its size factor.
        orientation: orientation in which it was put on its guide, ``wxyz``.
        friction: friction coefficient of its surface.
        stiffness: stiffness of its skin together with the pad's layer, relative to the layer's alone.
        member: its solid at nominal size, where its shape is a family; None for any other shape, and for the nominal
            solid of a family.
        offset: displacement of its centre from the middle of the palm before a pose turns it, ``(3,)`` [m], if a hand
            keeps it.
    """

    shape_index: int
    scale: float
    orientation: Quaternion
    friction: float = 1.0
    stiffness: float = 1.0
    member: Shape | None = None
    offset: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class Placement:
    """An object in front of the pad, ready to be pressed.

    ``orientation`` is a unit quaternion ``wxyz`` from the object's frame to the pad's; ``offset (2,)`` is the position
    of its centre from the approach axis, along y and z [m]; ``friction`` is the coefficient of sliding friction on the
    pad; ``stiffness`` is that of the pad's layer and the object's skin together, relative to the pad's alone.
    """

    shape: Shape
    scale: float
    orientation: Quaternion
    offset: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    friction: float = 1.0
    stiffness: float = 1.0

    def __post_init__(self) -> None:
        numbers = (self.scale, self.friction, self.stiffness, *self.offset, *self.orientation)
        if not (all(map(isfinite, numbers)) and min(self.scale, self.stiffness) > 0.0 and self.friction >= 0.0):
            raise ValueError(
                f"scale and stiffness must be above zero, friction at least zero, all finite; got {self}, friction "
                f"{self.friction}, stiffness {self.stiffness}"
            )
        require_unit("orientation", self.orientation)

    @property
    def bounding_radius(self) -> float:
        """Radius of the smallest ball about its centre that contains it [m]."""
        return self.shape.bounding_radius * self.scale

    def __str__(self) -> str:
        return (
            f"{self.shape} at scale {self.scale:.3g} in orientation {np.round(self.orientation, 4).tolist()}, "
            f"offset {np.asarray(self.offset).tolist()} m"
        )
