"""Contacts: the forces, depths and pressures of one press, and their time series."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.poses import to_matrix
from activetouch.pressing.pad import Pad
from activetouch.solids.raster import foremost
from activetouch.solids.solid import Floats


class Phase(StrEnum):
    """Phases of a press (paper §5.3); the paper's forward phase is split at first contact."""

    APPROACH = "approach"
    CONTACT = "contact"
    PAUSE = "pause"
    WITHDRAW = "withdraw"


@dataclass(frozen=True, eq=False)
class Trace:
    """Time series of a press with T steps.

    Attributes:
        time: since the start [s], ``(T,)``.
        position: of the object's centre [m], ``(T, 3)``, world frame.
        force: of the pad on the object [N], ``(T, 3)``, world frame; +x points away from the pad.
        point: where the force acts, along y and z from the pad's centre [m], ``(T, 2)``; 0 without contact.
        phase: of the motion, ``(T,)``.
    """

    time: Floats
    position: Floats
    force: Floats
    point: Floats
    phase: Sequence[Phase]

    def __len__(self) -> int:
        return len(self.time)

    def select(self, rows: slice) -> Trace:
        """The steps in a slice."""
        return Trace(self.time[rows], self.position[rows], self.force[rows], self.point[rows], self.phase[rows])

    @property
    def end_of_pause(self) -> int:
        """Index of the step after the pause; 0 without a pause, as in a miss."""
        return next((row for row in range(len(self), 0, -1) if self.phase[row - 1] is Phase.PAUSE), 0)


@dataclass(frozen=True, eq=False)
class Contact:
    """The contact of one press; arrays are ``(num_taxels, num_taxels)``, rows along z, columns along y.

    Attributes:
        pad: the pressed pad.
        gap: distance of the object's surface behind its first point of contact [m], ≥ 0; ``inf`` beside the object. It
            may be too large where it is larger than the pad's maximal depth, which no press closes.
        force: normal force in the pause [N]; 0 for a miss.
        indentation: of the pad's surface [m], ≥ 0.
        pressure: on every taxel [Pa]; its integral is ``force`` unless the layer bottomed out.
        trace: time series of the press, if recorded.
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
        """Whether the layer reached its maximal depth before it carried the force, as under a sharp tip."""
        return self.depth >= self.pad.max_depth

    @property
    def centre_of_pressure(self) -> Floats:
        """Point where the force acts, along y and z from the pad's centre [m], ``(2,)``; 0 without pressure."""
        total = self.pressure.sum()
        if total == 0.0:
            return np.zeros(2)
        return (self.pad.taxel_centres[1:] @ self.pressure.ravel()) / total


class PressedObject(NamedTuple):
    """Result of one press, or of one grasp of a hand with m fingers.

    Attributes:
        contact: the physics; of a grasp, that of its first finger.
        image: the sensor's image, ``(n, n)`` or ``(n, n, 3)`` uint8; of a grasp ``(n, m · n)``, fingers side by side.
        num_unsettled: presses before it that did not settle.
        placement: where the object was; of a grasp, in front of a finger that is not turned.
        ideal: the image before the sensor's faults, in [0, 1].
        contacts: of all fingers; the force of one that misses is 0.
    """

    contact: Contact
    image: NDArray[np.uint8]
    num_unsettled: int
    placement: Placement
    ideal: NDArray[np.floating]
    contacts: tuple[Contact, ...]


def elastic_contact(pad: Pad, gap: Floats, force: float, stiffness: float = 1.0, trace: Trace | None = None) -> Contact:
    """The contact of a rigid surface with the pad's elastic foundation under a given force (decision 0003).

    Args:
        pad: the pad.
        gap: from :func:`surface_gap`.
        force: normal force [N]; ignored if the object misses the pad.
        stiffness: of the layer and the object's skin together, relative to the pad's.
        trace: of the press.
    """
    force = force if np.isfinite(gap.min()) else 0.0
    indentation = pad.indentation(gap, force / stiffness) - gap
    np.maximum(indentation, 0.0, out=indentation)
    return Contact(pad, gap, force, indentation, (stiffness * pad.stiffness) * indentation, trace)


def missed(pad: Pad) -> Contact:
    """The contact of a pad that meets nothing."""
    zeros = np.zeros((pad.num_taxels, pad.num_taxels))
    return Contact(pad, np.full_like(zeros, np.inf), 0.0, zeros, zeros)


def surface_gap(pad: Pad, placement: Placement) -> Floats:
    """Gap between the pad and an object that just touches it, ``(num_taxels, num_taxels)`` [m].

    The smallest value is 0. It is ``inf`` beside the object, and everywhere for a miss. Gaps that are larger than the
    pad's maximal depth, which no press closes, may be too large.
    """
    return first_touch(pad, placement)[0]


def first_touch(pad: Pad, placement: Placement) -> tuple[Floats, float]:
    """:func:`surface_gap`, and the distance of the object's centre from the pad [m], ``nan`` for a miss."""
    shape, turn = placement.shape, to_matrix(placement.orientation) * placement.scale
    within = np.inf if shape.geom.presses == "surface" else pad.max_depth  # all of what a simulation takes a hull of
    pixel = 2 * pad.half_width / pad.num_taxels
    reached = foremost(shape.surface, turn, np.asarray(placement.offset), pixel, pad.num_taxels, within)
    touching = float(reached.max())
    return (touching - reached, touching) if np.isfinite(touching) else (-reached, np.nan)
