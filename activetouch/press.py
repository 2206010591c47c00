"""How a press comes to its force: stepped MuJoCo dynamics, or straight to the force-balanced end.

Both fidelities answer one question, with which normal force the object rests on the pad, and share the same
force law for the imprint (:mod:`activetouch.contact`). ``Dynamic`` is the paper's approach–contact–pause–
withdraw cycle in MuJoCo (paper §5.3): it knows motion, contact timing, overshoot and misses. ``Quasistatic``
steps no time at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from activetouch.errors import UnstablePress
from activetouch.pad import Pad
from activetouch.poses import Quaternion
from activetouch.shapes import Shape

if TYPE_CHECKING:
    from activetouch.rig import Rig


class Press(Protocol):
    """A way to press an object against the pad."""

    def force(
        self,
        pad: Pad,
        shape: Shape,
        scale: float,
        orientation: Quaternion,
        offset: np.ndarray,
        target_force: float,
    ) -> float:
        """Normal force in the pause [N]; 0 when the object never met the pad.

        Args:
            pad: the pad.
            shape: the object's shape at nominal size.
            scale: its size factor.
            orientation: unit quaternion, object to pad frame.
            offset: (y, z) of the object's centre [m].
            target_force: force at which the guide stops [N].

        Raises:
            UnstablePress: the simulation diverged.
        """


@dataclass(frozen=True)
class Quasistatic:
    """The object rests on the pad with exactly the target force; no time is stepped, no MuJoCo is loaded."""

    def force(
        self,
        pad: Pad,
        shape: Shape,
        scale: float,
        orientation: Quaternion,
        offset: np.ndarray,
        target_force: float,
    ) -> float:
        """See :class:`Press`. A miss shows in the gap, which is infinite everywhere."""
        return target_force


@dataclass(frozen=True)
class Dynamic:
    """A guarded move in stepped MuJoCo: approach, contact, pause, withdraw.

    The guide moves at ``speed`` until the pad pushes back, then with a velocity proportional to the missing
    force (admittance control), so approach, force stop and pause are one law. Reaching the far end of the
    guide without contact is a miss.

    Attributes:
        timestep: of the simulation [s].
        speed: of the free approach and of the withdrawal [m/s].
        admittance: velocity per newton of missing force [m/s/N].
        pause: how long the force is held before it is read [s].
        start: distance of the object's centre from the pad at the start [m]; larger objects start further.
        travel: how far past the pad's face the centre may go before it counts as a miss [m].
    """

    timestep: float = 0.002
    speed: float = 0.1
    admittance: float = 0.05
    pause: float = 0.08
    start: float = 0.05
    travel: float = 0.005

    @cached_property
    def _rigs(self) -> dict[tuple[Pad, Shape], Rig]:
        return {}

    def __getstate__(self) -> dict[str, float]:
        """Leave the compiled models behind: another process compiles its own."""
        return {name: value for name, value in self.__dict__.items() if name != "_rigs"}

    def force(
        self,
        pad: Pad,
        shape: Shape,
        scale: float,
        orientation: Quaternion,
        offset: np.ndarray,
        target_force: float,
    ) -> float:
        """See :class:`Press`."""
        from activetouch.rig import Rig  # loads MuJoCo

        rig = self._rigs.get((pad, shape))
        if rig is None:
            rig = self._rigs[pad, shape] = Rig(pad, shape, self.timestep)
        position = max(self.start, shape.bounding_radius * scale + pad.max_depth)
        rig.place(position, scale, orientation, offset)
        withdrawn = position
        force, steps_left, in_contact = 0.0, round(self.pause / self.timestep), False
        while position > -self.travel and steps_left > 0:
            velocity = self.admittance * (target_force - force)
            position -= self.timestep * min(max(velocity, -self.speed), self.speed)
            force = rig.step(position)
            in_contact = in_contact or force >= 0.9 * target_force
            steps_left -= in_contact
        held = force if in_contact else 0.0
        while position < withdrawn and rig.force > 0.0:  # until the pad is free again
            position += self.timestep * self.speed
            rig.step(position)
        if rig.num_warnings or not np.isfinite(held) or held > 10 * target_force + 1.0:
            raise UnstablePress(
                f"pressing {shape} at scale {scale:.3g} in orientation {np.round(orientation, 4).tolist()} gave "
                f"{held:.3g} N for a stop at {target_force:.3g} N and {rig.num_warnings} MuJoCo warnings. "
                f"Try a smaller timestep (now {self.timestep} s) or a lower speed (now {self.speed} m/s)."
            )
        return held
