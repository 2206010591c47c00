"""The paper's press: move until the force exceeds a threshold, pause, withdraw (paper §5.3)."""

from __future__ import annotations

from dataclasses import dataclass

from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, elastic_contact, first_touch
from activetouch.pressing.dynamic import SteppedPress, require_force
from activetouch.pressing.facing import facing_geom
from activetouch.pressing.pad import Pad
from activetouch.pressing.trace import Phase

_LARGEST_FORCE = 1e4  # [N]; a larger force means that the simulation diverged
MOST_FORCE = (2.0, 1.0)
"""A guarded move fails if it holds more than this factor times its threshold, plus this many newtons."""


@dataclass(frozen=True)
class GuardedMove(SteppedPress):
    """Forward at constant speed until the force exceeds a threshold, hold that position, and go back.

    The force in the pause is not controlled: it differs from the threshold by the effect of the object's momentum and
    of the last step. A press that exceeds the threshold by far fails (:data:`MOST_FORCE`). The trace begins shortly
    before the first contact and ends when the pad is free again.

    Attributes:
        timestep: of the simulation [s].
        speed: forward and backward [m/s].
        pause: time to hold the position before the force is read [s].
        start: distance of the object's centre from the pad at the start [m]; larger objects start further away.
        travel: distance past the pad's face, or the first touch if that is behind it, at which the guide ends [m].
        rotation_time: of the object between two presses [s], on which no touch depends.
    """

    timestep: float = 0.002
    speed: float = 0.02
    pause: float = 0.2
    start: float = 0.04
    travel: float = 0.005
    rotation_time: float = 0.2

    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`; ``target_force`` is the threshold."""
        require_force(target_force)
        gap, touching = first_touch(pad, placement)
        rig, withdrawn = self._place(pad, placement, facing_geom(pad, placement, gap, touching))
        advance = self.timestep * self.speed
        skipped = rig.skip_approach(withdrawn, self.speed, touching) if target_force > 0.0 else 0
        position, force, step = withdrawn - skipped * advance, 0.0, rig.step
        end = min(0.0, touching) - self.travel  # of a hollow, the centre may lie behind its surface; nan for a miss
        while position > end and force < target_force:
            position -= advance
            force = step(position, Phase.CONTACT if force > 0.0 else Phase.APPROACH)
        for _ in range(round(self.pause / self.timestep)):
            force = step(position, Phase.PAUSE)
        while position < withdrawn and rig.force > 0.0:  # until the pad is free again
            position = min(position + advance, withdrawn)
            step(position, Phase.WITHDRAW)
        if rig.num_warnings or not 0.0 <= force < _LARGEST_FORCE:
            raise UnstablePress(
                f"pressing {placement}: {force:.3g} N in the pause, {rig.num_warnings} MuJoCo warnings. Try a smaller "
                f"timestep (now {self.timestep} s) or speed (now {self.speed} m/s)."
            )
        factor, margin = MOST_FORCE
        if force > factor * target_force + margin:
            raise UnstablePress(
                f"pressing {placement}: the threshold is {target_force:.3g} N, and the pause holds {force:.3g} N, "
                f"because at {self.speed} m/s the object's momentum carries it on. Try a speed of "
                f"{self.speed * target_force / force:.2g} m/s, or Dynamic, which controls the force."
            )
        return elastic_contact(pad, gap, force, placement.stiffness, rig.trace())

    @property
    def traced(self) -> bool:
        """See :class:`Press`."""
        return True
