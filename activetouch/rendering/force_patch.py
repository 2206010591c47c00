"""The paper's tactile image: a force vector drawn as a patch (paper §5.5).

Each reading of force and contact point in a short time window is drawn as a disc at that point, with a radius
proportional to the force. The discs are summed, smoothed, normalised and coloured. The paper does not give the
parameters; these are ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from activetouch.pressing.contact import Contact
    from activetouch.pressing.pad import Pad

Floats = NDArray[np.float64]

_TRUNCATED = 4.0  # of the Gaussian, in standard deviations


@dataclass(frozen=True)
class ForcePatchRenderer:
    """Discs at the contact points, Gaussian-smoothed, normalised to their maximum, in a matplotlib colormap.

    Attributes:
        window: length of the time window drawn into one image [s].
        radius_per_newton: radius of a disc per newton [m/N].
        smoothing: standard deviation of the Gaussian, relative to the pad's edge.
        colormap: name of the colormap.
    """

    isotropic: ClassVar[bool] = True
    reads_taxels: ClassVar[bool] = False

    window: float = 0.05
    radius_per_newton: float = 0.0015
    smoothing: float = 0.015
    colormap: str = "viridis"

    def __call__(self, contact: Contact) -> Floats:
        """The image ``(num_taxels, num_taxels, 3)`` of the window that ends with the pause."""
        if contact.trace is None:  # no simulated time: one reading, normal to the pad
            return self._draw(contact.pad, np.array([contact.force]), contact.centre_of_pressure[None])
        return self._window(contact, contact.trace.end_of_pause)

    def windows(self, contact: Contact, stride: float) -> Iterator[Floats]:
        """Images of a window that slides over the time in contact in steps of ``stride`` [s] (paper §5.6).

        Raises:
            ValueError: the contact has no trace.
        """
        if contact.trace is None:
            raise ValueError("the contact has no trace; press with a fidelity that records one, such as GuardedMove")
        touched = np.flatnonzero(contact.trace.force.any(axis=1))
        if touched.size:
            step = np.diff(contact.trace.time[:2]).item()
            for end in range(touched[0] + 1, touched[-1] + 2, max(1, round(stride / step))):
                yield self._window(contact, end)

    def _window(self, contact: Contact, end: int) -> Floats:
        trace = contact.trace
        assert trace is not None, "callers check"
        rows = trace.select(slice(0, end))
        recent = rows.time > (rows.time[-1] - self.window if end else 0.0)
        return self._draw(contact.pad, np.linalg.norm(rows.force[recent], axis=1), rows.point[recent])

    def _draw(self, pad: Pad, magnitudes: Floats, points: Floats) -> Floats:
        magnitudes, points = magnitudes[magnitudes > 0.0], points[magnitudes > 0.0]
        image = np.zeros((pad.num_taxels, pad.num_taxels))
        if magnitudes.size:
            # At least a taxel wide, or a small force on a coarse pad would draw nothing.
            radii = np.maximum(self.radius_per_newton * magnitudes, pad.half_width / pad.num_taxels * np.sqrt(2.0))
            self._add_discs(image, pad, magnitudes, points, radii)
        brightest = image.max()
        return _colours(self.colormap)[np.rint(255 * (image / brightest if brightest > 0.0 else image)).astype(int)]

    def _add_discs(self, image: Floats, pad: Pad, magnitudes: Floats, points: Floats, radii: Floats) -> None:
        """Draw the smoothed discs into a black image; only the pixels that they reach are computed."""
        from scipy.ndimage import gaussian_filter  # which takes a tenth of a second

        edge = pad.taxel_centres[2].reshape(pad.num_taxels, -1)[:, 0]  # the same along rows and columns
        deviation = self.smoothing * pad.num_taxels
        reach = int(_TRUNCATED * deviation + 0.5)
        low = np.searchsorted(edge, (points - radii[:, None]).min(axis=0), side="left") - reach
        high = np.searchsorted(edge, (points + radii[:, None]).max(axis=0), side="right") + reach
        columns, rows = (slice(max(0, first), max(0, last)) for first, last in zip(low, high, strict=True))
        across, up = edge[columns] - points[:, :1], edge[rows] - points[:, 1:]
        inside = (up**2)[:, :, None] + (across**2)[:, None, :] <= radii[:, None, None] ** 2
        if inside.size:
            intensity = np.einsum("r,rij->ij", magnitudes, inside)
            image[rows, columns] = gaussian_filter(intensity, deviation, truncate=_TRUNCATED)


@lru_cache(maxsize=8)
def _colours(name: str) -> Floats:
    """A colormap as a table ``(256, 3)``."""
    import matplotlib  # slow to import, so only here

    return np.asarray(matplotlib.colormaps[name](np.arange(256))[:, :3])
