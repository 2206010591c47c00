"""A guarded move with force control in stepped MuJoCo: approach, contact, pause, withdraw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, elastic_contact, first_touch
from activetouch.pressing.press import Press
from activetouch.pressing.setup import Setup
from activetouch.pressing.trace import Phase
from activetouch.shapes import Shape

if TYPE_CHECKING:
    import mujoco

_LONGEST_STEP = 0.001  # [m]


def require_steps(timestep: float, speed: float, pause: float) -> None:
    """Refuse a motion that could jump through the pad, or a pause of no steps."""
    if not pause >= timestep > 0.0:
        raise ValueError(f"pause must be at least one timestep, got {pause} s and {timestep} s")
    if not 0.0 < speed * timestep <= _LONGEST_STEP:
        raise ValueError(
            f"speed × timestep must be in (0, {_LONGEST_STEP} m], or the object could pass through the pad in one "
            f"step; got {speed} m/s × {timestep} s"
        )


def require_force(target_force: float) -> None:
    """Refuse a force that is negative or not finite."""
    if not 0.0 <= target_force < float("inf"):
        raise ValueError(f"target_force must be finite and ≥ 0 N, got {target_force}")


def start_position(start: float, setup: Setup, placement: Placement) -> float:
    """Where a press starts: ``start`` [m] in front of the pad, or further for an object that would touch it there."""
    return max(start, placement.bounding_radius + setup.pad.max_depth)


@dataclass(frozen=True)
class Dynamic(Press):
    """The object moves at ``speed`` until the pad pushes back, then with a velocity proportional to the missing force.

    The force is read once it has stayed near the stop for the whole ``pause`` (admittance control). At the far end of
    the guide it is read whatever it is: nothing after a miss, little where the object glances off the pad's rim.

    Attributes:
        timestep: of the simulation [s].
        speed: of the free approach and of the withdrawal [m/s].
        admittance: velocity per newton of missing force [m/s/N].
        tolerance: how near the force must stay to the stop, relative.
        pause: for how long [s].
        patience: how long to wait for that before giving up [s].
        start: distance of the object's centre from the pad at the start [m]; larger objects start further.
        travel: how far past the pad's face the centre may go before it counts as a miss [m].
        traced: whether to sense force vector and contact point in every step, for ``Contact.trace``.
    """

    moves: ClassVar[bool] = True

    timestep: float = 0.002
    speed: float = 0.1
    admittance: float = 0.02
    tolerance: float = 0.1
    pause: float = 0.04
    patience: float = 2.0
    start: float = 0.05
    travel: float = 0.005
    traced: bool = False

    def __post_init__(self) -> None:
        require_steps(self.timestep, self.speed, self.pause)

    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        from activetouch.pressing.rig import shared_rig  # loads MuJoCo

        require_force(target_force)
        rig = shared_rig(setup, placement.shape, self.timestep, self.traced)
        position = withdrawn = start_position(self.start, setup, placement)
        rig.place(position, placement)
        force, num_settled, num_steps = 0.0, 0, 0
        wanted = round(self.pause / self.timestep)
        limit = round((self.patience + position / self.speed) / self.timestep)
        while position > -self.travel and num_settled < wanted and num_steps < limit:
            velocity = self.admittance * (target_force - force) if force > 0.0 else self.speed
            position -= self.timestep * min(max(velocity, -self.speed), self.speed)
            force = rig.step(position, Phase.CONTACT if force > 0.0 else Phase.APPROACH)
            near = abs(force - target_force) <= self.tolerance * target_force
            num_settled = num_settled + 1 if near else 0
            num_steps += 1
        at_end = position <= -self.travel  # missed, or glancing off: hold there, and read what there is to read
        if num_settled == wanted:
            rig.relabel(wanted, Phase.PAUSE)  # which steps were the pause shows only at its end
        elif at_end and force > 0.0:
            for _ in range(wanted):
                force = rig.step(position, Phase.PAUSE)
        gap, touching = first_touch(setup.pad, placement)
        pressed_through = touching - position > 2 * setup.pad.half_thickness
        while position < withdrawn and (rig.force > 0.0 or self.traced):  # until the pad is free again
            position = min(position + self.timestep * self.speed, withdrawn)
            rig.step(position, Phase.WITHDRAW)
        if rig.num_warnings or pressed_through or not (at_end or num_settled == wanted):
            raise UnstablePress(
                f"pressing {placement}: the force did not settle at {target_force:.3g} N (last {force:.3g} N, step "
                f"{num_steps}, {rig.num_warnings} MuJoCo warnings). Try a smaller timestep (now {self.timestep} s) or "
                f"speed (now {self.speed} m/s)."
            )
        return elastic_contact(setup.pad, gap, force, placement.stiffness, rig.trace())

    def compiled(self, setup: Setup, shape: Shape) -> mujoco.MjModel:
        """See :class:`Press`."""
        from activetouch.pressing.rig import build_spec  # loads MuJoCo

        return build_spec(setup, shape, self.timestep, self.traced).compile()

    def with_trace(self) -> Dynamic:
        """See :class:`Press`."""
        return replace(self, traced=True)
