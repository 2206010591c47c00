"""What every renderer is: a callable from contact to image, and the check of what it gives."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import WrongRenderer
from activetouch.pressing.contact import Contact

_RULE = "a renderer gives floating-point images in [0, 1], (n, n) in grey or (n, n, 3) in colour"
_SLACK = 1e-6  # below 0, of rounding
_HIGHEST = 10.0  # a taxel that is pressed beyond full scale saturates; this is no pressure but another unit


class TactileRenderer(Protocol):
    """Turns the physics of a press into the image an ideal sensor would give.

    The rule: an image is a floating-point array with values in [0, 1], 1 being full scale, of shape ``(n, n)`` in grey
    or ``(n, n, 3)`` in colour, and of the same shape for every contact. What exceeds full scale saturates; values below
    0 or far above 1, such as an image of bytes that was not divided by 255, and values that are not finite, are a
    :class:`activetouch.errors.WrongRenderer`. Every image is checked.

    Attributes:
        isotropic: whether a turned or mirrored contact gives the turned or mirrored image.
    """

    isotropic: ClassVar[bool]

    def __call__(self, contact: Contact) -> NDArray[np.float64]:
        """The image in [0, 1]: ``(n, n)``, or ``(n, n, 3)`` in colour; n is ``num_taxels`` unless taxels are binned.

        Rows run along z, columns along y. A miss gives the image of the untouched pad.
        """


def require_renderer(renderer: object) -> None:
    """Refuse what cannot be a renderer.

    Raises:
        WrongRenderer: it is not callable, or does not say whether it is isotropic.
    """
    if isinstance(renderer, str):
        raise WrongRenderer(
            f"a scene's renderer is an object, not the name {renderer!r}; activetouch.rendering.RENDERERS has the "
            "known ones by name"
        )
    if isinstance(renderer, type) or not callable(renderer):
        raise WrongRenderer(f"{renderer!r} is no renderer: it must be an object that is called with a contact")
    if not isinstance(getattr(renderer, "isotropic", None), bool):
        raise WrongRenderer(
            f"{renderer!r} does not say whether it is isotropic (whether a turned or mirrored contact gives the turned "
            "or mirrored image): give its class an attribute isotropic, True or False"
        )


def require_image(image: NDArray[np.floating], renderer: object) -> NDArray[np.floating]:
    """An image, if it keeps the rule of :class:`TactileRenderer`.

    Raises:
        WrongRenderer: it does not.
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
