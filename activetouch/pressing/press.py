"""The protocol of presses, and the simplest one: interchangeable ways in which an object comes to press on the pad.

``Quasistatic`` simulates no time: the object rests on the pad with exactly the target force. ``Dynamic``
(:mod:`activetouch.pressing.dynamic`) simulates the motion in MuJoCo, with contact timing and misses; ``GuardedMove``
(:mod:`activetouch.pressing.guarded_move`) is the paper's own cycle in the same physics. These three compute the imprint
by one force law (:func:`activetouch.pressing.contact.elastic_contact`). ``Deformable``
(:mod:`activetouch.pressing.deformable`) simulates a soft pad in MuJoCo; it is slow, and the reference for the others.
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
from activetouch.shapes import Shape

if TYPE_CHECKING:
    import mujoco


class Press(Protocol):
    """A way to press an object against the pad. Derive a press of your own from this class; only `press` is required.

    Attributes:
        moves: whether the object's motion is simulated, so that it can slide or bounce.
        is_slow: whether one press takes seconds.
        deforms: whether the pad itself is simulated as a soft body, so that the imprint does not follow from the
            object's geometry and depth alone.
    """

    moves: ClassVar[bool] = False
    is_slow: ClassVar[bool] = False
    deforms: ClassVar[bool] = False

    @property
    def traced(self) -> bool:
        """Whether contacts carry a time series of force and contact point (``Contact.trace``)."""
        return False

    @abstractmethod
    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        """The contact in the pause, without force where the object never met the pad.

        Args:
            setup: the pad and what else is modelled.
            placement: the object.
            target_force: force at which the motion stops [N].

        Raises:
            UnstablePress: the simulation diverged.
        """

    def compiled(self, setup: Setup, shape: Shape) -> mujoco.MjModel | None:
        """The MuJoCo model of a press of this shape; None where MuJoCo is not used."""
        return None

    def with_trace(self) -> Press:
        """This press with a trace, if it can record one."""
        return self

    def rotate(self, setup: Setup, placement: Placement, orientation: Quaternion) -> Trace:
        """The time series of turning the withdrawn object from its placement to another orientation.

        Args:
            setup: the pad and what else is modelled.
            placement: the object, before it is turned.
            orientation: unit quaternion ``wxyz``, after it is turned.

        Raises:
            WrongPress: this kind of press does not simulate rotations.
        """
        raise WrongPress(f"rotations are simulated by guarded moves only, not by {self}; use the scene 'paper'")


@dataclass(frozen=True)
class Quasistatic(Press):
    """A press without simulated time: the object rests on the pad with exactly the target force. It needs no MuJoCo."""

    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        return elastic_contact(setup.pad, surface_gap(setup.pad, placement), target_force, placement.stiffness)
