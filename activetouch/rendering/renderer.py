"""What every renderer is: a callable from contact to image."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.contact import Contact


class TactileRenderer(Protocol):
    """Turns the physics of a press into the image an ideal sensor would read."""

    def __call__(self, contact: Contact) -> NDArray[np.float64]:
        """The image ``(num_taxels, num_taxels)`` in [0, 1]; all zero for a miss."""
