"""What every renderer is: a callable from contact to image."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.contact import Contact


class TactileRenderer(Protocol):
    """Turns the physics of a press into the image an ideal sensor would give.

    Attributes:
        isotropic: whether a turned or mirrored contact gives the turned or mirrored image.
    """

    isotropic: ClassVar[bool]

    def __call__(self, contact: Contact) -> NDArray[np.float64]:
        """The image in [0, 1]: ``(n, n)``, or ``(n, n, 3)`` in colour; n is ``num_taxels`` unless taxels are binned.

        Rows run along z, columns along y. A miss gives the image of the untouched pad.
        """
