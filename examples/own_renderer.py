"""A renderer of your own: a binary image of the contact area, without the pressure.

Run in this folder:

    activetouch touch --renderer "own_renderer:Outline(threshold=0.1)" --shape cube --out cube.png
    activetouch compare --renderer own_renderer:Outline --sensor gel --anyway --targets sphere --episodes 5

In the second command, the sensor of ``gel`` reads images on which it was not trained, so it reads them badly. To train
a sensor on them, call ``activetouch.make_sensor``, or run ``compare`` without --anyway, which prints the commands.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.pressing.contact import Contact
from activetouch.rendering import check_renderer


@dataclass(frozen=True)
class Outline:
    """Image that is one where the pressure is above a fraction of its maximum, and zero elsewhere.

    Attributes:
        threshold: this fraction.
    """

    threshold: float = 0.05
    isotropic = True  # a rotated contact gives the rotated image

    def __call__(self, contact: Contact) -> NDArray[np.floating]:
        """The image, values in [0, 1]."""
        pressure = contact.pressure
        return (pressure > self.threshold * max(float(pressure.max()), 1.0)).astype(np.float64)


if __name__ == "__main__":
    print(f"images of {check_renderer(Outline())} pixels: the renderer meets the contract")
