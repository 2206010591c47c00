"""Images of an array of pressure taxels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.contact import Contact


@dataclass(frozen=True)
class PressureRenderer:
    """Mean pressure on every taxel, relative to full scale, the pressure at which the layer bottoms out.

    Attributes:
        binning: number of pad points along the edge of one taxel. A coarse array is a fine pad whose points are
            averaged, so a taxel measures all contact on its area.
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
            raise ValueError(f"binning must divide the pad's {pad.num_taxels} points per edge, got {edge}")
        if edge == 1:
            return contact.pressure / (pad.stiffness * pad.max_depth)
        blocks = contact.pressure.reshape(pad.num_taxels // edge, edge, pad.num_taxels // edge, edge)
        return blocks.mean(axis=(1, 3)) / (pad.stiffness * pad.max_depth)
