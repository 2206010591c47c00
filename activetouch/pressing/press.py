"""The protocol of presses, and the simplest press.

``Quasistatic`` does not simulate time. ``Dynamic`` (:mod:`activetouch.pressing.dynamic`) and ``GuardedMove``
(:mod:`activetouch.pressing.dynamic`), the paper's cycle, simulate the motion in MuJoCo. All compute the imprint by
one force law (:func:`activetouch.pressing.contact.elastic_contact`).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, elastic_contact, first_touch, surface_gap
from activetouch.pressing.pad import Pad
from activetouch.solids.solid import Shape

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class Grasp:
    """What m fingers feel that closed on a body.

    Attributes:
        contacts: of the fingers; the force of one that misses is 0.
        met: what each finger has in front of it in the end.
        centre: of the body, from the middle of the palm along each finger's axis, ``(m,)`` [m].
        net_force: sum of the fingers' forces, with friction where it is simulated, ``(3,)`` [N]: what the palm holds.
    """

    contacts: tuple[Contact, ...]
    met: tuple[Placement, ...]
    centre: NDArray[np.float64]
    net_force: NDArray[np.float64]

    @property
    def stops(self) -> NDArray[np.float64]:
        """Where the pads' faces stop, from the middle of the palm, ``(m,)`` [m]; ``nan`` for a finger that misses."""
        each = zip(self.contacts, self.met, strict=True)
        return np.array([first_touch(one.pad, seen)[1] - one.depth for one, seen in each]) - self.centre


class Press(Protocol):
    """A way to press an object against the pad. Derive your own press from this class; only ``press`` is required.

    Attributes:
        moves: whether the object's motion is simulated, so that it can slide or bounce.
    """

    moves: ClassVar[bool] = False

    @property
    def traced(self) -> bool:
        """Whether contacts carry a time series of force and contact point (``Contact.trace``)."""
        return False

    @property
    def closes(self) -> bool:
        """Whether the fingers of a hand can close by it; where nothing moves, each presses by itself."""
        return not self.moves

    @abstractmethod
    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """The contact in the pause; its force is 0 for a miss.

        Args:
            target_force: force at which the motion stops [N].
        """

    def compiled(self, pad: Pad, shape: Shape) -> mujoco.MjModel | None:
        """The MuJoCo model of a press of this shape; None if the press does not use MuJoCo."""
        return None

    def with_trace(self) -> Press:
        """This press with a trace of its motion, if it can record one."""
        return self

    def close(
        self,
        pad: Pad,
        met: Sequence[Placement],
        fingers: NDArray[np.float64],
        centre: NDArray[np.float64],
        forces: Sequence[float],
    ) -> Grasp:
        """What fingers feel when they close on a body; by default, each presses by itself.

        Args:
            met: what each of the m fingers has in front of it.
            fingers: rotations of the pads about the middle of the palm, ``(m, 3, 3)``; they press along the first
                columns.
            centre: of the body in the palm, ``(3,)`` [m].
            forces: of the fingers [N].
        """
        contacts = tuple(self.press(pad, seen, float(force)) for seen, force in zip(met, forces, strict=True))
        axes = fingers[:, :, 0]
        return Grasp(contacts, tuple(met), axes @ centre, np.array([one.force for one in contacts]) @ axes)


@dataclass(frozen=True)
class Quasistatic(Press):
    """A press without simulated time: the object rests on the pad with exactly the target force."""

    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        return elastic_contact(pad, surface_gap(pad, placement), target_force, placement.stiffness)
