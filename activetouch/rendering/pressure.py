"""Images of an array of pressure taxels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
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
        return self.mean_pressure(contact.pressure) / (contact.pad.stiffness * contact.pad.max_depth)

    def mean_pressure(self, pressure: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pressure at every point of the pad ``(..., N, N)``, averaged over each taxel ``(..., n, n)``.

        Raises:
            ValueError: ``binning`` does not divide N.
        """
        num_points, edge = pressure.shape[-1], self.binning
        if num_points % edge:
            raise ValueError(f"binning must divide the pad's {num_points} points per edge, got {edge}")
        if edge == 1:
            return pressure
        blocks = pressure.reshape(*pressure.shape[:-2], num_points // edge, edge, num_points // edge, edge)
        return blocks.mean(axis=(-3, -1))
