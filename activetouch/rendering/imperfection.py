"""What a real sensor adds to the image: an uncertain gain, noise, saturation and an 8-bit converter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Imperfection:
    """Gain error and additive noise, drawn anew for every touch.

    Attributes:
        gain: half-range of the uniform gain error, relative.
        noise: standard deviation of the taxel noise, relative to full scale.
    """

    gain: float = 0.10
    noise: float = 0.02

    def __call__(self, image: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint8]:
        """The reading of an image in [0, 1], saturated and quantised to 8 bits."""
        gain = 1.0 + rng.uniform(-self.gain, self.gain)
        noise = self.noise * rng.standard_normal(image.shape, dtype=np.float32)
        return np.rint(255.0 * np.clip(gain * image + noise, 0.0, 1.0)).astype(np.uint8)
