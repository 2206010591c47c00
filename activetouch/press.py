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
from activetouch.placement import Placement
from activetouch.shapes import Shape

if TYPE_CHECKING:
    from activetouch.rig import Rig


_LONGEST_STEP = 0.001  # [m]


class Press(Protocol):
    """A way to press an object against the pad."""

    def force(self, pad: Pad, placement: Placement, target_force: float) -> float:
        """Normal force in the pause [N]; 0 when the object never met the pad.

        Args:
            pad: the pad.
            placement: the object.
            target_force: force at which the guide stops [N].

        Raises:
            UnstablePress: the simulation diverged.
        """


@dataclass(frozen=True)
class Quasistatic:
    """The object rests on the pad with exactly the target force; no time is stepped, no MuJoCo is loaded."""

    def force(self, pad: Pad, placement: Placement, target_force: float) -> float:
        """See :class:`Press`; it is not asked about an object that misses the pad."""
        return target_force


@dataclass(frozen=True)
class Dynamic:
    """A guarded move in stepped MuJoCo: approach, contact, pause, withdraw.

    The guide moves at ``speed`` until the pad pushes back, then with a velocity proportional to the missing force
    (admittance control), and the force is read once it has stayed near the stop for the whole ``pause``. Reaching
    the far end of the guide without contact is a miss.

    Attributes:
        timestep: of the simulation [s].
        speed: of the free approach and of the withdrawal [m/s].
        admittance: velocity per newton of missing force [m/s/N].
        tolerance: how near the force must stay to the stop, relative.
        pause: for how long [s].
        patience: how long to wait for that before giving up [s].
        start: distance of the object's centre from the pad at the start [m]; larger objects start further.
        travel: how far past the pad's face the centre may go before it counts as a miss [m].
    """

    timestep: float = 0.002
    speed: float = 0.1
    admittance: float = 0.02
    tolerance: float = 0.1
    pause: float = 0.04
    patience: float = 2.0
    start: float = 0.05
    travel: float = 0.005

    def __post_init__(self) -> None:
        if not self.pause >= self.timestep > 0.0:
            raise ValueError(f"pause must be at least one timestep, got {self.pause} s and {self.timestep} s")
        if not 0.0 < self.speed * self.timestep <= _LONGEST_STEP:
            raise ValueError(
                f"speed × timestep must be in (0, {_LONGEST_STEP} m], or the object could pass through the pad in one "
                f"step; got {self.speed} m/s × {self.timestep} s"
            )

    @cached_property
    def _rigs(self) -> dict[tuple[Pad, Shape], Rig]:
        return {}

    def __getstate__(self) -> dict[str, float]:
        """Leave the compiled models behind: another process compiles its own."""
        return {name: value for name, value in self.__dict__.items() if name != "_rigs"}

    def force(self, pad: Pad, placement: Placement, target_force: float) -> float:
        """See :class:`Press`."""
        from activetouch.rig import Rig  # loads MuJoCo

        key = (pad, placement.shape)
        rig = self._rigs.get(key)
        if rig is None:
            rig = self._rigs[key] = Rig(pad, placement.shape, self.timestep)
        position = max(self.start, placement.bounding_radius + pad.max_depth)
        rig.place(position, placement)
        withdrawn = position
        force, num_settled, num_steps = 0.0, 0, 0
        wanted = round(self.pause / self.timestep)
        limit = round((self.patience + position / self.speed) / self.timestep)
        while position > -self.travel and num_settled < wanted and num_steps < limit:
            velocity = self.admittance * (target_force - force) if force > 0.0 else self.speed
            position -= self.timestep * min(max(velocity, -self.speed), self.speed)
            force = rig.step(position)
            near = abs(force - target_force) <= self.tolerance * target_force
            num_settled = num_settled + 1 if near else 0
            num_steps += 1
        missed = position <= -self.travel and force == 0.0
        while position < withdrawn and rig.force > 0.0:  # until the pad is free again
            position += self.timestep * self.speed
            rig.step(position)
        if rig.num_warnings or not (missed or num_settled == wanted):
            raise UnstablePress(
                f"pressing {placement.shape} at scale {placement.scale:.3g} in orientation "
                f"{np.round(placement.orientation, 4).tolist()}, offset {placement.offset.tolist()} m: the force "
                f"did not settle at {target_force:.3g} N (last {force:.3g} N, step {num_steps}, {rig.num_warnings} "
                f"MuJoCo warnings). Try a smaller timestep (now {self.timestep} s) or speed (now {self.speed} m/s)."
            )
        return 0.0 if missed else force
