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
    """The grasp of m fingers that closed on a body: contacts, and what each finger has in front of it in the end.

    The force of a finger that misses is 0. ``centre (m,)`` is that of the body, from the middle of the palm along each
    finger's axis [m]; ``net_force (3,)``, which the palm holds, has friction where it is simulated [N].
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
    """A way to press an object against the pad; a subclass needs only ``press``.

    ``moves`` says whether the object's motion is simulated, so that it can slide or bounce.
    """

    moves: ClassVar[bool] = False

    @property
    def traced(self) -> bool:
        """Whether contacts carry a time series of force and contact point (``Contact.trace``)."""
        return False

    @property
    def closes(self) -> bool:
        """Whether it can close the fingers of a hand; where nothing moves, each presses by itself."""
        return not self.moves

    @abstractmethod
    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """The contact in the pause, where the motion stops at ``target_force`` [N]; its force is 0 for a miss."""

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
        """The grasp of m fingers that close on a body with ``forces`` [N]; by default, each presses by itself.

        ``met`` is what each has in front of it, ``fingers (m, 3, 3)`` the rotations of the pads about the middle of the
        palm, which press along the first columns, and ``centre (3,)`` that of the body in the palm [m].
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
