"""The protocol of renderers, and checks of renderers and their images."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import WrongRenderer

if TYPE_CHECKING:
    from activetouch.pressing.contact import Contact

_RULE = "a renderer gives floating-point images in [0, 1], (n, n) in grey or (n, n, 3) in colour"
_SLACK = 1e-6  # rounding errors below 0
_HIGHEST = 10.0  # taxels saturate above full scale; values beyond this have another unit


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

    def __call__(self, contact: Contact) -> NDArray[np.float64]:
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
