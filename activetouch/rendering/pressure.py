"""What an array of pressure taxels reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.contact import Contact


@dataclass(frozen=True)
class PressureRenderer:
    """Mean pressure on every taxel, relative to the pad's full scale, where the layer bottoms out.

    Attributes:
        binning: points of the pad along an edge that one taxel covers. A coarse array feels everything that presses on
            it, not only what lies above the taxels' centres; so it is a fine pad whose points are read together.
    """

    isotropic: ClassVar[bool] = True

    binning: int = 1

    def __post_init__(self) -> None:
        if self.binning < 1:
            raise ValueError(f"binning must be at least 1, got {self.binning}")

    def __call__(self, contact: Contact) -> NDArray[np.float64]:
        """The image ``(n, n)`` in [0, 1] with n = num_taxels / binning; all zero for a miss.

        Raises:
            ValueError: ``binning`` does not divide the pad's number of points.
        """
        pad, edge = contact.pad, self.binning
        if pad.num_taxels % edge:
            raise ValueError(f"binning must divide the pad's {pad.num_taxels} points an edge, got {edge}")
        if edge == 1:
            return contact.pressure / (pad.stiffness * pad.max_depth)
        blocks = contact.pressure.reshape(pad.num_taxels // edge, edge, pad.num_taxels // edge, edge)
        return blocks.mean(axis=(1, 3)) / (pad.stiffness * pad.max_depth)
