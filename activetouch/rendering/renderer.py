"""The contract of renderers, which scenes, collections and networks rely on, and its checks."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import WrongRenderer
from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, elastic_contact, missed, surface_gap
from activetouch.pressing.pad import Pad
from activetouch.shapes import SHAPES
from activetouch.solids.round import Sphere
from belief.errors import BrokenContract

_FORCES = (0.01, 1.0, 3.0, 100.0)  # [N]
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
