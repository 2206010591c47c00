"""The geometry-resolved pressure image: what an ideal array of pressure taxels reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.contact import Contact


@dataclass(frozen=True)
class PressureRenderer:
    """Pressure relative to the pad's full scale, where the layer bottoms out."""

    def __call__(self, contact: Contact) -> NDArray[np.float64]:
        """The image ``(num_taxels, num_taxels)`` in [0, 1]; all zero for a miss."""
        return contact.pressure / (contact.pad.stiffness * contact.pad.max_depth)
