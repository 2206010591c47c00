"""Presses simulated step by step in MuJoCo: approach, contact, pause, withdraw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, elastic_contact, first_touch
from activetouch.pressing.facing import facing_geom
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Press
from activetouch.pressing.trace import Phase
from activetouch.solids.solid import Geom, Shape

if TYPE_CHECKING:
    import mujoco

    from activetouch.pressing.rig import Rig

_LONGEST_STEP = 0.001  # [m]


def require_force(target_force: float) -> None:
    """Check that a force is finite and ≥ 0."""
    if not 0.0 <= target_force < float("inf"):
        raise ValueError(f"target_force must be finite and ≥ 0 N, got {target_force}")


class SteppedPress(Press):
    """A press whose motion is simulated in MuJoCo on a rigid pad with a soft contact.

    The free approach is simulated from ``start`` only where it is recorded. Otherwise the simulation begins shortly
    before the first contact, in the state that the approach leads to (decision 0044).

    Attributes:
        timestep: of the simulation [s].
        speed: of the free motion [m/s].
        pause: duration of the pause [s].
        start: distance of the object's centre from the pad at the start [m]; larger objects start further away.
    """

    moves: ClassVar[bool] = True

    timestep: float
    speed: float
    pause: float
    start: float

    def __post_init__(self) -> None:
        if not self.pause >= self.timestep > 0.0:
            raise ValueError(f"pause must be at least one timestep, got {self.pause} s and {self.timestep} s")
        if not 0.0 < self.speed * self.timestep <= _LONGEST_STEP:
            raise ValueError(
                f"speed × timestep must be in (0, {_LONGEST_STEP} m], or the object could pass through the pad in one "
                f"step; got {self.speed} m/s × {self.timestep} s"
            )

    def compiled(self, pad: Pad, shape: Shape) -> mujoco.MjModel:
        """See :class:`Press`."""
        from activetouch.pressing.rig import build_spec  # loads MuJoCo

        return build_spec(pad, shape, self.timestep, self.traced).compile()

    def _place(self, pad: Pad, placement: Placement, facing: Geom | None = None) -> tuple[Rig, float]:
        """The rig with the object at the start, and the position of the object's centre [m]."""
        from activetouch.pressing.rig import Rig, shared_rig  # loads MuJoCo

        if facing is None:
            rig = shared_rig(pad, placement.shape, self.timestep, self.traced)
        else:
            rig = Rig(pad, placement.shape, self.timestep, self.traced, facing=facing)
        position = max(self.start, placement.bounding_radius + pad.max_depth)
        rig.place(position, placement)
        return rig, position


@dataclass(frozen=True)
class Dynamic(SteppedPress):
    """A guarded move with admittance control: in contact, the velocity is proportional to the force error.

    The press ends when the force has stayed near the target force for the whole ``pause``. If the guide reaches its end
    before, the force is read there: 0 after a miss, little if the object glances off the pad's rim.

    Attributes:
        timestep: of the simulation [s].
        speed: of the free approach and of the withdrawal [m/s].
        admittance: velocity per newton of force error [m/s/N].
        tolerance: largest relative force error in the pause.
        pause: time during which the error must stay within the tolerance [s].
        patience: time in contact after which the press fails [s].
        start: distance of the object's centre from the pad at the start [m]; larger objects start further away.
        travel: distance past the pad's face, or the first touch if that is behind it, at which the guide ends [m].
        traced: whether to record force vector and contact point in every step, for ``Contact.trace``.
    """

    timestep: float = 0.002
    speed: float = 0.1
    admittance: float = 0.02
    tolerance: float = 0.1
    pause: float = 0.04
    patience: float = 2.0
    start: float = 0.05
    travel: float = 0.005
    traced: bool = False

    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        from mujoco import mj_step

        require_force(target_force)
        gap, touching = first_touch(pad, placement)
        rig, withdrawn = self._place(pad, placement, facing_geom(pad, placement, gap, touching))
        advance, gain = self.timestep * self.speed, self.timestep * self.admittance  # per step [m], per newton [m/N]
        deepest = min(0.0, touching)  # of a hollow, the centre may lie behind its surface; nan for a miss
        end, slack = deepest - self.travel, self.tolerance * target_force
        skips = target_force > slack and not self.traced  # else the force 0 of the approach is near enough
        num_steps = rig.skip_approach(withdrawn, self.speed, touching) if skips else 0
        position = withdrawn - num_steps * advance
        force, num_settled = 0.0, 0
        wanted = round(self.pause / self.timestep)
        limit = round((self.patience + (withdrawn - deepest) / self.speed) / self.timestep)
        model, data, command, reaction, step = rig.model, rig.data, rig.command, rig.reaction, rig.step
        while position > end and num_settled < wanted and num_steps < limit:
            if force > 0.0:
                moves = gain * (target_force - force)
                position -= -advance if moves < -advance else advance if moves > advance else moves
            else:
                position -= advance
            if self.traced:
                force = step(position, Phase.CONTACT if force > 0.0 else Phase.APPROACH)
            else:  # Rig.step without its call, which takes a twentieth of the time
                command[0] = position
                mj_step(model, data)
                force = reaction[0]
                if force < 0.0:
                    force = 0.0
            num_settled = num_settled + 1 if -slack <= force - target_force <= slack else 0
            num_steps += 1
        at_end = position <= end  # missed, or glancing off
        if num_settled == wanted:
            rig.relabel(wanted, Phase.PAUSE)  # known only after the pause
        elif at_end and force > 0.0:
            for _ in range(wanted):
                force = step(position, Phase.PAUSE)
        pressed_through = touching - position > 2 * pad.half_thickness
        while self.traced and position < withdrawn:  # the withdrawal changes nothing but the trace
            position = min(position + advance, withdrawn)
            step(position, Phase.WITHDRAW)
        if rig.num_warnings or pressed_through or not (at_end or num_settled == wanted):
            raise UnstablePress(
                f"pressing {placement}: the force did not settle at {target_force:.3g} N (last {force:.3g} N, step "
                f"{num_steps}, {rig.num_warnings} MuJoCo warnings). Try a smaller timestep (now {self.timestep} s) or "
                f"speed (now {self.speed} m/s)."
            )
        return elastic_contact(pad, gap, force, placement.stiffness, rig.trace())

    def with_trace(self) -> Dynamic:
        """See :class:`Press`."""
        return replace(self, traced=True)
