"""A check of the contract of renderers, which scenes, collections and networks rely on."""

from __future__ import annotations

import numpy as np

from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, elastic_contact, surface_gap
from activetouch.pressing.pad import Pad
from activetouch.rendering.renderer import TactileRenderer, require_image, require_renderer
from activetouch.shapes import SHAPES
from activetouch.solids.round import Sphere
from belief.errors import BrokenContract

_FORCES = (0.01, 1.0, 3.0, 100.0)  # [N]


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
    nothing = np.zeros((pad.num_taxels, pad.num_taxels))
    contacts: dict[str, Contact] = {"a miss": Contact(pad, np.full_like(nothing, np.inf), 0.0, nothing, nothing)}
    for name, shape in {"sphere": Sphere(0.02), **SHAPES}.items():
        for force in _FORCES:
            placement = Placement(shape, 1.0, np.array([0.9, 0.3, 0.3, 0.1]) / np.linalg.norm([0.9, 0.3, 0.3, 0.1]))
            contacts[f"a {name} at {force} N"] = elastic_contact(pad, surface_gap(pad, placement), force)
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
