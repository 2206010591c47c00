"""The physics record of one press, before any picture is made of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.poses import to_matrix
from activetouch.pressing.pad import Pad
from activetouch.pressing.trace import Trace

Floats = NDArray[np.float64]

# Arrays of up to 128 kB are taken from memory at hand; larger ones are asked of the system anew each time, at twice the
# cost of the rays themselves.
_RAYS_AT_ONCE = 8192


@dataclass(frozen=True, eq=False)
class Contact:
    """What one press did to the pad.

    Attributes:
        pad: the pad that was pressed.
        gap: distance of the object's surface behind its first point of contact, for every taxel, ≥ 0, ``inf``
            beside the object [m], ``(num_taxels, num_taxels)``.
        force: normal force in the pause [N]; 0 for an object that missed the pad.
        indentation: how far each taxel's surface is pushed in, ≥ 0 [m], ``(num_taxels, num_taxels)``.
        pressure: on every taxel [Pa], ``(num_taxels, num_taxels)``; its integral is ``force`` unless the layer
            bottomed out.
        trace: of the press, step by step, where it was asked for.
    """

    pad: Pad
    gap: Floats
    force: float
    indentation: Floats
    pressure: Floats
    trace: Trace | None = None

    @property
    def depth(self) -> float:
        """Indentation of the deepest taxel [m]."""
        return float(self.indentation.max())

    @property
    def is_bottomed_out(self) -> bool:
        """Whether the layer reached its limit before it carried the force, as under a sharp tip."""
        return self.depth >= self.pad.max_depth

    @property
    def centre_of_pressure(self) -> Floats:
        """Where the force acts, along y and z from the pad's centre [m], ``(2,)``; 0 without pressure."""
        total = self.pressure.sum()
        if total == 0.0:
            return np.zeros(2)
        return (self.pad.taxel_centres[1:] @ self.pressure.ravel()) / total


def elastic_contact(pad: Pad, gap: Floats, force: float, stiffness: float = 1.0, trace: Trace | None = None) -> Contact:
    """The contact of a rigid surface with the pad's elastic foundation under a given force (decision 0003).

    Args:
        pad: the pad.
        gap: from :func:`surface_gap`.
        force: normal force [N]; ignored where no taxel is below the object.
        stiffness: of layer and object skin together, relative to the pad's.
        trace: of the press.
    """
    force = force if np.isfinite(gap.min()) else 0.0
    indentation = pad.indentation(gap, force / stiffness) - gap
    np.maximum(indentation, 0.0, out=indentation)
    return Contact(pad, gap, force, indentation, (stiffness * pad.stiffness) * indentation, trace)


def contact_at_depth(pad: Pad, gap: Floats, depth: float, stiffness: float = 1.0) -> Contact:
    """:func:`elastic_contact` the other way round: the contact whose deepest taxel is indented by ``depth``.

    Args:
        pad: the pad.
        gap: from :func:`surface_gap`.
        depth: of the deepest taxel, in ``[0, pad.max_depth]`` [m].
        stiffness: of layer and object skin together, relative to the pad's.

    Raises:
        ValueError: the layer is not as deep as that, or the depth is negative or NaN.
    """
    if not 0.0 <= depth <= pad.max_depth:
        raise ValueError(f"depth must be in [0, {pad.max_depth:g}] m, where the layer ends; got {depth:g}")
    indentation = np.maximum(depth - gap, 0.0)
    pressure = (stiffness * pad.stiffness) * indentation
    return Contact(pad, gap, float(pressure.sum()) * pad.taxel_area, indentation, pressure)


def with_numbers_of(lender: Contact, contact: Contact, stiffness: float = 1.0) -> Contact:
    """A contact as it would look with the force and the depth of another: a control, not physics.

    The indentation is as deep as the lender's, and the force in the pause as large, although this surface would need
    another force for that depth. The forces of a trace are scaled alike, and act where they did.

    Args:
        lender: gives force and depth.
        contact: gives the gap, and the points of its trace.
        stiffness: of layer and object skin together, relative to the pad's, for this contact.

    Raises:
        ValueError: the lender is deeper than the contact's layer.
    """
    shown = contact_at_depth(contact.pad, contact.gap, lender.depth, stiffness)
    trace, held = contact.trace, _held_force(contact)
    if trace is not None and held > 0.0:
        trace = replace(trace, force=trace.force * (_held_force(lender) / held))
    return replace(shown, force=lender.force, trace=trace)


def _held_force(contact: Contact) -> float:
    """Length of the force vector at the end of the pause [N], friction included where there is a trace."""
    if contact.trace is None:
        return contact.force
    return float(np.linalg.norm(contact.trace.force[contact.trace.end_of_pause - 1])) if contact.force else 0.0


def surface_gap(pad: Pad, placement: Placement) -> Floats:
    """Gap between the pad and an object that just touches it, for every taxel [m].

    Returns:
        ``(num_taxels, num_taxels)``, smallest value 0, ``inf`` where no surface lies above the taxel; all ``inf`` when
        the object misses the pad.
    """
    return first_touch(pad, placement)[0]


def first_touch(pad: Pad, placement: Placement) -> tuple[Floats, float]:
    """:func:`surface_gap`, and how far the object's centre is in front of the pad then [m]; ``nan`` for a miss."""
    rotation = to_matrix(placement.orientation)
    to_object = rotation.T / placement.scale  # the object's frame, at nominal size
    clearance = 2 * placement.bounding_radius  # any distance at which every taxel is outside the object
    centre = to_object @ np.array([[clearance], [placement.offset[0]], [placement.offset[1]]])
    distance = np.empty(pad.num_taxels**2)
    for first_ray in range(0, len(distance), _RAYS_AT_ONCE):
        rays = slice(first_ray, first_ray + _RAYS_AT_ONCE)
        origins = to_object @ pad.taxel_centres[:, rays]
        origins -= centre
        distance[rays] = placement.shape.entry_distance(origins, rotation[0])
    distance *= placement.scale
    nearest = float(distance.min())
    square = distance.reshape(pad.num_taxels, pad.num_taxels)
    return (square - nearest, clearance - nearest) if np.isfinite(nearest) else (square, np.nan)
