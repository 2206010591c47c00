"""Images of a GelSight sensor: a camera behind a reflecting membrane under three coloured lights (Yuan et al. 2017).

The membrane is the smoothed indentation. By Lambert's law, its slope determines how much of each light it reflects to
the camera. Red, green and blue come from three sides, so an untouched pad is evenly grey.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from activetouch.pressing.contact import Contact

_AZIMUTHS = np.deg2rad([90.0, 210.0, 330.0])  # of the red, green and blue light


@dataclass(frozen=True)
class GelSightRenderer:
    """Shading of the smoothed indentation.

    Attributes:
        smoothing: standard deviation of the Gaussian that smooths the indentation [m].
        elevation: angle of the lights above the membrane [rad]; a lower angle increases the contrast of slopes.
        brightness: grey value of the untouched pad, in [0, 1].
    """

    isotropic: ClassVar[bool] = False  # each colour of light comes from one side

    smoothing: float = 0.0003
    elevation: float = np.deg2rad(45.0)
    brightness: float = 0.45

    def __call__(self, contact: Contact) -> NDArray[np.float64]:
        """The image ``(num_taxels, num_taxels, 3)``.

        Raises:
            ValueError: the pad has only one taxel.
        """
        pad = contact.pad
        if pad.num_taxels < 2:
            raise ValueError("a GelSight image needs a pad of at least 2 × 2 taxels")
        spacing = 2 * pad.half_width / pad.num_taxels
        from scipy.ndimage import gaussian_filter  # which takes a tenth of a second

        surface = -gaussian_filter(contact.indentation, self.smoothing / spacing)
        along_z, along_y = np.gradient(surface, spacing)
        normal = np.stack([-along_y, -along_z, np.ones_like(surface)]) / np.sqrt(1 + along_y**2 + along_z**2)
        lights = np.stack([np.cos(_AZIMUTHS), np.sin(_AZIMUTHS), np.full(3, np.tan(self.elevation))])
        shading = np.einsum("ixy,ic->xyc", normal, lights) / np.tan(self.elevation)  # 1 where it is flat
        return np.clip(self.brightness * shading, 0.0, 1.0)
