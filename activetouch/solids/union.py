"""Solids joined into one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from activetouch.solids.solid import Floats, Geom, Shape, corners


@dataclass(frozen=True)
class Union:
    """Boxes, cylinders and polyhedra that overlap and share their origin, such as a plate and a boss on it.

    MuJoCo collides with the convex hull of what lies in front of the pad.

    Attributes:
        parts: the solids, at least one.

    Raises:
        ValueError: there is no part, or one is round, as a sphere.

    >>> from activetouch.solids.straight import Box
    >>> cross = Union((Box((3.0, 1.0, 1.0)), Box((1.0, 3.0, 1.0))))
    >>> cross.entry_distance(np.array([[2.0, 2.0], [0.0, 2.0], [5.0, 5.0]]), np.array([0.0, 0.0, -1.0])).tolist()
    [4.0, inf]
    """

    parts: tuple[Shape, ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise ValueError("a union needs at least one part")
        for part in self.parts:
            corners(part.geom)  # raises for a round solid

    @property
    def bounding_radius(self) -> float:
        """See :class:`Shape`."""
        return max(part.bounding_radius for part in self.parts)

    @cached_property
    def geom(self) -> Geom:
        """The corners of all parts. See :class:`Shape`."""
        return Geom("mesh", vertices=np.vstack([corners(part.geom) for part in self.parts]), presses="surface")

    def entry_distance(self, origins: Floats, direction: Floats) -> Floats:
        """See :class:`Shape`."""
        return np.min([part.entry_distance(origins, direction) for part in self.parts], axis=0)
