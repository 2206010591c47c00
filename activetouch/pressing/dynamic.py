"""Presses simulated step by step in MuJoCo: approach, contact, pause, withdraw."""

from __future__ import annotations

import threading
from abc import abstractmethod
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from activetouch.errors import UnstablePress
from activetouch.poses import Placement, to_matrix
from activetouch.pressing.contact import Contact, Pad, Phase, Press, elastic_contact, first_touch
from activetouch.solids.solid import Floats, Geom, Shape, on_spiral
from belief.constraints import NOT_NEGATIVE, require_rule
from belief.validation import are_finite

if TYPE_CHECKING:
    import mujoco

    from activetouch.pressing.rig import Rig
    from activetouch.pressing.surroundings import Surroundings

_LONGEST_STEP = 0.001  # [m]
_NUM_DIRECTIONS = 32  # in which the hull of what faces the pad is exact, besides the one towards the pad
_LARGEST_FORCE = 1e4  # [N]; a larger force means that the simulation diverged
MOST_FORCE = (2.0, 1.0)
"""A guarded move fails if it holds more than this factor times its threshold, plus this many newtons."""
_ONE_PRESS_AT_A_TIME = threading.Lock()  # the rigs are shared by the threads of the process


class SteppedPress(Press):
    """A press whose motion is simulated in MuJoCo on a rigid pad with a soft contact.

    Without a trace, the simulation begins shortly before the first contact, in the state that the approach from
    ``start`` leads to (decision 0003).
    """

    moves: ClassVar[bool] = True

    timestep: float
    speed: float
    pause: float
    start: float
    surroundings: Surroundings | None

    def __post_init__(self) -> None:
        if not self.pause >= self.timestep > 0.0:
            raise ValueError(f"pause must be at least one timestep, got {self.pause} s and {self.timestep} s")
        if not (are_finite(self.speed) and 0.0 < self.speed * self.timestep <= _LONGEST_STEP):
            raise ValueError(
                f"speed × timestep must be in (0, {_LONGEST_STEP} m], or the object could pass through the pad in one "
                f"step; got {self.speed} m/s × {self.timestep} s"
            )

    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`; ``target_force`` is the threshold of a guarded move. Threads wait for each other."""
        with _ONE_PRESS_AT_A_TIME:
            return self._press(pad, placement, target_force)

    @abstractmethod
    def _press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """The contact in the pause, by the shared rig of the shape."""

    def compiled(self, pad: Pad, shape: Shape) -> mujoco.MjModel:
        """See :class:`Press`."""
        return self._rig(pad, shape).model

    def _rig(self, pad: Pad, shape: Shape, facing: Geom | None = None) -> Rig:
        """The rig of a shape, or of the geom that stands for it."""
        from activetouch.pressing.rig import Rig, shared_rig  # loads MuJoCo

        around = None if self.surroundings is None else self.surroundings.beside(shape)
        if facing is None:
            return shared_rig(pad, shape, self.timestep, self.traced, around)
        return Rig(pad, facing, self.timestep, self.traced, around=around)

    def _begin(self, pad: Pad, placement: Placement, target_force: float) -> tuple[Rig, float, Floats, float]:
        """The rig with the object at the start, the position of its centre [m], and the first touch."""
        require_rule("target_force", target_force, NOT_NEGATIVE)
        gap, touching = first_touch(pad, placement)
        rig = self._rig(pad, placement.shape, facing_geom(pad, placement, gap, touching))
        position = max(self.start, placement.bounding_radius + pad.max_depth)
        rig.place(position, placement)
        return rig, position, gap, touching


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
        surroundings: what else to simulate, which no touch depends on.
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
    surroundings: Surroundings | None = field(default=None, repr=False, metadata={"changes_touches": False})

    def _press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        from mujoco import mj_step

        rig, withdrawn, gap, touching = self._begin(pad, placement, target_force)
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


@dataclass(frozen=True)
class GuardedMove(SteppedPress):
    """The paper's press (§5.3): forward at constant speed until the force exceeds a threshold, hold, and go back.

    The force in the pause is not controlled: it differs from the threshold by the effect of the object's momentum and
    of the last step. A press that exceeds the threshold by far fails (:data:`MOST_FORCE`). The trace begins shortly
    before the first contact and ends when the pad is free again.

    Attributes:
        timestep, start, travel, surroundings: as of :class:`Dynamic`.
        speed: forward and backward [m/s].
        pause: time to hold the position before the force is read [s].
        rotation_time: of the object between two presses [s], on which no touch depends.
    """

    timestep: float = 0.002
    speed: float = 0.02
    pause: float = 0.2
    start: float = 0.04
    travel: float = 0.005
    rotation_time: float = 0.2
    surroundings: Surroundings | None = field(default=None, repr=False, metadata={"changes_touches": False})

    def _press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        rig, withdrawn, gap, touching = self._begin(pad, placement, target_force)
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


def facing_geom(pad: Pad, placement: Placement, gap: Floats, touching: float) -> Geom | None:
    """The geom that stands for the object in MuJoCo, whose meshes are convex; None if that is the shape's own geom.

    A flat pad that moves along x meets only the points of a hollow object in front of its face, and none of these
    behind their convex hull. The hull of these points, extended away from the pad, therefore makes first contact where
    the true surface does; the walls of a hollow beside the pad are not touched. Where the pad meets the foremost point
    of the whole object first, the hull of the object, which is compiled already, makes the same contact. The gap [m],
    ``(num_taxels, num_taxels)``, and ``touching`` [m] are from :func:`activetouch.pressing.contact.first_touch`.
    """
    geom = placement.shape.geom
    if geom.presses != "surface":
        return None
    assert geom.vertices is not None, "what is hollow has corners"
    rotation = to_matrix(placement.orientation)
    foremost = geom.vertices[np.argmin(geom.vertices @ rotation[0])]
    if np.abs(placement.scale * (rotation[1:] @ foremost) + placement.offset).max() <= pad.half_width:
        return None
    met = np.isfinite(gap.ravel())
    points = pad.taxel_centres[:, met]
    points[0] = gap.ravel()[met] - touching
    points[1:] -= np.asarray(placement.offset)[:, None]
    if not met.any():  # a miss: out of the reach of the pad
        points = np.array([[placement.bounding_radius + 4 * pad.half_thickness], [0.0], [0.0]])
    towards = on_spiral(-(np.arange(_NUM_DIRECTIONS) + 0.5) / _NUM_DIRECTIONS)  # the half-space of the pad
    directions = np.vstack([[-1.0, 0.0, 0.0], towards[:, [2, 0, 1]]])
    hull = points[:, np.argmax(directions @ points, axis=1)]
    hull[1:] += pad.half_width / pad.num_taxels * np.where(directions.T[1:] < 0.0, -1.0, 1.0)  # a taxel is a square
    behind = hull + np.array([[2 * pad.half_thickness], [0.0], [0.0]])
    return Geom("mesh", vertices=(rotation.T @ np.hstack([hull, behind])).T / placement.scale)
