"""How a press comes to its force: interchangeable fidelities behind one protocol.

``Quasistatic`` steps no time: the object rests on the pad with exactly the target force. ``Dynamic``
(:mod:`activetouch.pressing.dynamic`) steps MuJoCo and knows motion, contact timing and misses; ``GuardedMove``
(:mod:`activetouch.pressing.guarded_move`) is the paper's own cycle in the same physics. These share one force law for
the imprint (:func:`activetouch.pressing.contact.elastic_contact`). ``Deformable``
(:mod:`activetouch.pressing.deformable`) has a soft pad that deforms in MuJoCo, slow, and the reference for the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, elastic_contact, surface_gap
from activetouch.pressing.setup import Stage


class Press(Protocol):
    """A way to press an object against the pad."""

    def press(self, stage: Stage, placement: Placement, target_force: float) -> Contact:
        """The contact in the pause, without force where the object never met the pad.

        Args:
            stage: the pad and what else is modelled.
            placement: the object.
            target_force: force at which the motion stops [N].

        Raises:
            UnstablePress: the simulation diverged.
        """


@dataclass(frozen=True)
class Quasistatic:
    """The object rests on the pad with exactly the target force; no time is stepped, no MuJoCo is loaded."""

    def press(self, stage: Stage, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        return elastic_contact(stage.pad, surface_gap(stage.pad, placement), target_force, placement.stiffness)
