"""The protocol of presses, and the simplest press.

``Quasistatic`` does not simulate time. ``Dynamic`` (:mod:`activetouch.pressing.dynamic`) and ``GuardedMove``
(:mod:`activetouch.pressing.guarded_move`), the paper's cycle, simulate the motion in MuJoCo. All compute the imprint by
one force law (:func:`activetouch.pressing.contact.elastic_contact`).
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

from activetouch.errors import WrongPress
from activetouch.placement import Placement
from activetouch.poses import Quaternion
from activetouch.pressing.contact import Contact, elastic_contact, surface_gap
from activetouch.pressing.setup import Setup
from activetouch.pressing.trace import Trace
from activetouch.solids.solid import Shape

if TYPE_CHECKING:
    import mujoco


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

    @abstractmethod
    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        """The contact in the pause; its force is 0 for a miss.

        Args:
            setup: the pad and its surroundings.
            placement: the object.
            target_force: force at which the motion stops [N].

        Raises:
            UnstablePress: the simulation diverged.
        """

    def compiled(self, setup: Setup, shape: Shape) -> mujoco.MjModel | None:
        """The MuJoCo model of a press of this shape; None if the press does not use MuJoCo."""
        return None

    def with_trace(self) -> Press:
        """This press with a trace of its complete motion, if it can record one."""
        return self

    def rotate(self, setup: Setup, placement: Placement, orientation: Quaternion) -> Trace:
        """The time series of a rotation of the withdrawn object to another orientation.

        Args:
            setup: the pad and its surroundings.
            placement: the object before the rotation.
            orientation: unit quaternion ``wxyz`` after the rotation.

        Raises:
            WrongPress: this press does not simulate rotations.
        """
        raise WrongPress(f"only guarded moves simulate rotations, not {self}; use the scene 'paper'")


@dataclass(frozen=True)
class Quasistatic(Press):
    """A press without simulated time: the object rests on the pad with exactly the target force."""

    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        return elastic_contact(setup.pad, surface_gap(setup.pad, placement), target_force, placement.stiffness)
