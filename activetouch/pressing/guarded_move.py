"""The paper's press: move until the force exceeds a threshold, pause, withdraw, rotate (paper §5.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.poses import Quaternion
from activetouch.pressing.contact import Contact, elastic_contact, surface_gap
from activetouch.pressing.dynamic import require_force, require_steps, start_position
from activetouch.pressing.press import Press
from activetouch.pressing.setup import Setup
from activetouch.pressing.trace import Phase, Trace
from activetouch.shapes import Shape

if TYPE_CHECKING:
    import mujoco

_LARGEST_FORCE = 1e4  # [N]; a pad that pushes harder than this is no pad


@dataclass(frozen=True)
class GuardedMove(Press):
    """Forward at constant speed, stop where the force reaches the threshold, hold that position, and go back.

    Nothing regulates the force: it is what the pad answers while the guide holds still, so it differs from the
    threshold by what the object's momentum and the last step added.

    Attributes:
        timestep: of the simulation [s].
        speed: forward and backward [m/s].
        pause: how long to hold before the force is read [s].
        start: distance of the object's centre from the pad at the start [m]; larger objects start further.
        travel: how far past the pad's face the centre may go; there it stops, touched or not [m].
        rotation_time: that a rotation between two presses takes [s].
    """

    moves: ClassVar[bool] = True

    timestep: float = 0.002
    speed: float = 0.02
    pause: float = 0.2
    start: float = 0.04
    travel: float = 0.005
    rotation_time: float = 0.2

    def __post_init__(self) -> None:
        require_steps(self.timestep, self.speed, self.pause)

    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`; ``target_force`` is the threshold."""
        from activetouch.pressing.rig import shared_rig  # loads MuJoCo

        require_force(target_force)
        rig = shared_rig(setup, placement.shape, self.timestep, traced=True)
        position = withdrawn = start_position(self.start, setup, placement)
        rig.place(position, placement)
        force = 0.0
        while position > -self.travel and force < target_force:
            position -= self.timestep * self.speed
            force = rig.step(position, Phase.CONTACT if force > 0.0 else Phase.APPROACH)
        for _ in range(round(self.pause / self.timestep)):
            force = rig.step(position, Phase.PAUSE)
        while position < withdrawn:
            position = min(position + self.timestep * self.speed, withdrawn)
            rig.step(position, Phase.WITHDRAW)
        if rig.num_warnings or not 0.0 <= force < _LARGEST_FORCE:
            raise UnstablePress(
                f"pressing {placement}: {force:.3g} N in the pause, {rig.num_warnings} MuJoCo warnings. Try a smaller "
                f"timestep (now {self.timestep} s) or speed (now {self.speed} m/s)."
            )
        return elastic_contact(setup.pad, surface_gap(setup.pad, placement), force, placement.stiffness, rig.trace())

    @property
    def traced(self) -> bool:
        """See :class:`Press`."""
        return True

    def compiled(self, setup: Setup, shape: Shape) -> mujoco.MjModel:
        """See :class:`Press`."""
        from activetouch.pressing.rig import build_spec  # loads MuJoCo

        return build_spec(setup, shape, self.timestep, traced=True).compile()

    def rotate(self, setup: Setup, placement: Placement, orientation: Quaternion) -> Trace:
        """See :class:`Press`; the object turns evenly and the short way."""
        from activetouch.pressing.rig import shared_rig  # loads MuJoCo

        rig = shared_rig(setup, placement.shape, self.timestep, traced=True)
        position = start_position(self.start, setup, placement)
        rig.place(position, placement)
        start, end = np.asarray(placement.orientation), np.asarray(orientation)
        end = end if start @ end >= 0.0 else -end  # the same rotation, the short way
        for share in np.linspace(0.0, 1.0, max(1, round(self.rotation_time / self.timestep)) + 1)[1:]:
            between = (1.0 - share) * start + share * end
            rig.turn(between / np.linalg.norm(between))
            rig.step(position, Phase.ROTATE)
        trace = rig.trace()
        assert trace is not None, "the rig was built with sensors"
        return trace
