"""Renderers: the contract that scenes, collections and networks rely on, its checks, and three of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import WrongRenderer
from activetouch.poses import Placement
from activetouch.pressing.contact import Contact, Pad, Trace, elastic_contact, missed, surface_gap
from activetouch.shapes import SHAPES
from activetouch.solids.primitives import Sphere
from activetouch.solids.solid import Floats
from belief.constraints import Count, check
from belief.errors import BrokenContract

_FORCES = (0.01, 1.0, 3.0, 100.0)  # [N]
_RULE = "a renderer gives floating-point images in [0, 1], (n, n) in grey or (n, n, 3) in colour"
_SLACK = 1e-6  # rounding errors below 0
_HIGHEST = 10.0  # taxels saturate above full scale; values beyond this have another unit
_AZIMUTHS = np.deg2rad([90.0, 210.0, 330.0])  # of GelSight's red, green and blue light
_TRUNCATED = 4.0  # of the Gaussian of force patches, in standard deviations


class TactileRenderer(Protocol):
    """Maps the contact of a press to the image of an ideal sensor.

    An image is a floating-point array with values in [0, 1], where 1 is full scale, of shape ``(n, n)`` in grey or
    ``(n, n, 3)`` in colour, and of the same shape for every contact. Values above full scale saturate. Values below 0,
    above 10 or not finite raise :class:`activetouch.errors.WrongRenderer`. Every image is checked.

    A renderer whose images are not readings of taxels may set ``reads_taxels = False``; ``robustness`` then leaves out
    faults of taxels.

    Attributes:
        isotropic: whether a turned or mirrored contact gives the turned or mirrored image.
    """

    isotropic: ClassVar[bool]

    def __call__(self, contact: Contact) -> Floats:
        """The image in [0, 1]; rows run along z, columns along y. A miss gives the image of the untouched pad."""


def require_renderer(renderer: object) -> None:
    """Check that an object can be a renderer.

    Raises:
        WrongRenderer: it is not callable, or does not say whether it is isotropic.
    """
    if isinstance(renderer, str):
        raise WrongRenderer(
            f"a scene's renderer is an object, not the name {renderer!r}; see activetouch.rendering.RENDERERS"
        )
    if isinstance(renderer, type) or not callable(renderer):
        raise WrongRenderer(f"{renderer!r} is no renderer: a renderer is an object that can be called with a contact")
    if not isinstance(getattr(renderer, "isotropic", None), bool):
        raise WrongRenderer(
            f"{renderer!r} has no attribute isotropic: set it to True if a turned or mirrored contact gives the turned "
            "or mirrored image, else to False"
        )


def require_image(image: NDArray[np.floating], renderer: object) -> NDArray[np.floating]:
    """The image, unchanged.

    Raises:
        WrongRenderer: it violates the rules of :class:`TactileRenderer`.
    """
    if not isinstance(image, np.ndarray) or image.dtype.kind != "f":
        kind = f"an array of {image.dtype}" if isinstance(image, np.ndarray) else f"a {type(image).__name__}"
        hint = "; divide by 255" if kind == "an array of uint8" else ""
        raise WrongRenderer(f"{renderer!r} gave {kind}{hint}: {_RULE}")
    edge = image.shape[0] if image.ndim else 0
    if edge == 0 or image.shape not in ((edge, edge), (edge, edge, 3)):
        raise WrongRenderer(f"{renderer!r} gave an image of shape {image.shape}: {_RULE}")
    lowest, highest = image.min(), image.max()  # NaN if there is one
    if not (lowest >= -_SLACK and highest <= _HIGHEST):
        hint = "; divide by 255" if _HIGHEST < highest <= 255 else ""
        raise WrongRenderer(f"{renderer!r} gave values from {lowest:.3g} to {highest:.3g}{hint}: {_RULE}")
    return image


def check_renderer(renderer: TactileRenderer, pad: Pad | None = None) -> tuple[int, ...]:
    """Check a renderer on a miss and on presses of every shape between 0.01 N and 100 N.

    It must have the attribute ``isotropic``. Its images must be floating-point arrays in [0, 1] of one shape, and the
    same for the same contact. It must not change the contact, and a pressed sphere must be visible.

    Args:
        renderer: the renderer to check.
        pad: the pad to render; a default :class:`Pad` if None.

    Returns:
        The shape of its images.

    Raises:
        WrongRenderer: an image violates the rules of :class:`TactileRenderer`, or the object is no renderer.
        BrokenContract: another rule is violated.

    >>> from activetouch.rendering import PressureRenderer
    >>> check_renderer(PressureRenderer())
    (128, 128)
    """
    require_renderer(renderer)
    pad = pad if pad is not None else Pad()
    contacts = {"a miss": missed(pad)}
    orientation = np.array([0.9, 0.3, 0.3, 0.1]) / np.linalg.norm([0.9, 0.3, 0.3, 0.1])
    for name, shape in {"sphere": Sphere(0.02), **SHAPES}.items():
        gap = surface_gap(pad, Placement(shape, 1.0, orientation))
        contacts |= {f"a {name} at {force} N": elastic_contact(pad, gap, force) for force in _FORCES}
    images = {}
    for name, contact in contacts.items():
        before = [np.array(part) for part in (contact.pressure, contact.indentation)]
        images[name] = np.array(require_image(renderer(contact), renderer))
        if images[name].shape != images["a miss"].shape:
            raise BrokenContract(
                f"{renderer!r} gives {images['a miss'].shape} for a miss and {images[name].shape} for {name}"
            )
        if not np.array_equal(images[name], renderer(contact)):
            raise BrokenContract(f"{renderer!r} gives another image of {name} when called again")
        if not all(np.array_equal(b, a) for b, a in zip(before, (contact.pressure, contact.indentation), strict=True)):
            raise BrokenContract(f"{renderer!r} changes the contact of {name}")
    if np.array_equal(images["a sphere at 3.0 N"], images["a miss"]):
        raise BrokenContract(f"{renderer!r} shows a sphere pressed with 3 N as it shows a miss")
    return images["a miss"].shape


@dataclass(frozen=True)
class PressureRenderer:
    """Mean pressure on every taxel, relative to full scale, the pressure at which the layer bottoms out.

    Attributes:
        binning: number of pad points along the edge of one taxel. A coarse array is a fine pad whose points are
            averaged, so a taxel measures all contact on its area.
    """

    isotropic: ClassVar[bool] = True

    binning: Count = 1

    def __post_init__(self) -> None:
        check(self)

    def __call__(self, contact: Contact) -> Floats:
        """The image ``(n, n)`` in [0, 1] with n = num_taxels / binning; all zero for a miss.

        Raises:
            ValueError: ``binning`` does not divide the pad's number of points.
        """
        return self.mean_pressure(contact.pressure) / (contact.pad.stiffness * contact.pad.max_depth)

    def mean_pressure(self, pressure: Floats) -> Floats:
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


@dataclass(frozen=True)
class GelSightRenderer:
    """A camera behind a reflecting membrane under three coloured lights, as in a GelSight sensor (Yuan et al. 2017).

    The membrane is the smoothed indentation. By Lambert's law, its slope determines how much of each light it reflects
    to the camera. Red, green and blue come from three sides, so an untouched pad is evenly grey.

    Attributes:
        smoothing: standard deviation of the Gaussian that smooths the indentation [m].
        elevation: angle of the lights above the membrane [rad]; a lower angle increases the contrast of slopes.
        brightness: grey value of the untouched pad, in [0, 1].
    """

    isotropic: ClassVar[bool] = False  # each colour of light comes from one side

    smoothing: float = 0.0003
    elevation: float = np.deg2rad(45.0)
    brightness: float = 0.45

    def __call__(self, contact: Contact) -> Floats:
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


@dataclass(frozen=True)
class ForcePatchRenderer:
    """The paper's tactile image: a force vector drawn as a patch (paper §5.5).

    Each reading of force and contact point in a short time window is drawn as a disc at that point, with a radius
    proportional to the force. The discs are summed, smoothed, normalised to their maximum and coloured. The paper does
    not give the parameters; these are ours.

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
        return self._window(contact.pad, contact.trace, contact.trace.end_of_pause)

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
                yield self._window(contact.pad, contact.trace, end)

    def _window(self, pad: Pad, trace: Trace, end: int) -> Floats:
        rows = trace.select(slice(0, end))
        recent = rows.time > (rows.time[-1] - self.window if end else 0.0)
        return self._draw(pad, np.linalg.norm(rows.force[recent], axis=1), rows.point[recent])

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
