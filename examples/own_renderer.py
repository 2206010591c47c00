"""A renderer of your own: an image of where the pad is touched, and nothing of how hard.

Run in this folder:

    activetouch touch --renderer "own_renderer:Outline(threshold=0.1)" --shape cube --out cube.png
    activetouch compare --renderer own_renderer:Outline --sensor gel --anyway --targets cube --episodes 5

The second command lets the sensor of ``gel`` read images that it was not trained on, which it does badly: for a sensor
that was trained on them, call ``activetouch.make_sensor`` or run the commands that ``compare`` names without --anyway.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.contact import Contact
from activetouch.rendering import check_renderer


@dataclass(frozen=True)
class Outline:
    """One where the pressure is above a share of its maximum, zero elsewhere.

    Attributes:
        threshold: that share.
    """

    threshold: float = 0.05
    isotropic = True  # a turned contact gives the turned image

    def __call__(self, contact: Contact) -> NDArray[np.floating]:
        """The image, values in [0, 1]."""
        pressure = contact.pressure
        return (pressure > self.threshold * max(float(pressure.max()), 1.0)).astype(np.float64)


if __name__ == "__main__":
    print(f"images of {check_renderer(Outline())} pixels: the contract of renderers is kept")
