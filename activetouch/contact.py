"""The physics record of one press, before any picture is made of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from activetouch.pad import Pad
from activetouch.placement import Placement
from activetouch.poses import to_matrix

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Contact:
    """What one press did to the pad.

    Attributes:
        pad: the pad that was pressed.
        gap: distance of the object's surface behind its first point of contact, for every taxel, ≥ 0, ``inf``
            beside the object [m], ``(num_taxels, num_taxels)``.
        force: normal force in the pause [N]; 0 for an object that missed the pad.
    """

    pad: Pad
    gap: Floats
    force: float

    @cached_property
    def depth(self) -> float:
        """Indentation of the deepest taxel [m]."""
        return self.pad.indentation(self.gap, self.force)

    @property
    def is_bottomed_out(self) -> bool:
        """Whether the layer reached its limit before it carried the force, as under a sharp tip."""
        return self.depth == self.pad.max_depth

    @property
    def pressure(self) -> Floats:
        """Pressure on every taxel [Pa]; its integral is ``force`` unless the layer bottomed out."""
        return self.pad.stiffness * np.maximum(self.depth - self.gap, 0.0)


def surface_gap(pad: Pad, placement: Placement) -> Floats:
    """Gap between the pad and an object that just touches it, for every taxel [m].

    Returns:
        ``(num_taxels, num_taxels)``, smallest value 0, ``inf`` where no surface lies above the taxel; all ``inf`` when
        the object misses the pad.
    """
    rotation = to_matrix(placement.orientation)
    clearance = 2 * placement.bounding_radius  # any distance at which every taxel is outside the object
    centre = np.array([[clearance], [placement.offset[0]], [placement.offset[1]]])
    origins = rotation.T @ (pad.taxel_centres - centre) / placement.scale  # object frame at nominal size, (3, n)
    distance = placement.shape.entry_distance(origins, rotation[0]) * placement.scale
    first = distance.min()
    gap = distance - first if np.isfinite(first) else distance
    return gap.reshape(pad.num_taxels, pad.num_taxels)
