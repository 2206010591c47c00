"""What stands around pad and object in the paper's world (§5.1, §5.2): a table, a finger, parked objects, a robot.

MuJoCo simulates its joints and servos in every step. It meets nothing, and the pad stays fixed in the world, so that
touches are the same to the last bit and only take longer (decision 0013).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path

import mujoco
import numpy as np

from activetouch.pressing.contact import Pad
from activetouch.pressing.rig import NO_CONTACT, Rig, add_guide, add_solid
from activetouch.solids.solid import Floats, Shape
from belief.errors import InvalidArgument

_HEIGHT = 0.07  # height of the pad above the table [m]
_TIP, _BASE = (0.02, 0.02, 0.02), (0.02, 0.02, 0.05)  # half-extents of the finger [m], whose base is on the table
_PARKING, _PITCH = np.array([0.10, 0.25, 0.0]), np.array([0.0, 0.10, 0.0])  # first place, and distance to the next [m]
_GREY, _BLUE, _WOOD = (0.6, 0.62, 0.66, 1), (0.3, 0.5, 0.75, 1), (0.85, 0.8, 0.72, 1)
_PANDA, ALLEGRO = Path("franka_emika_panda", "panda_nohand.xml"), Path("wonik_allegro", "right_hand.xml")
_MOUNT = (0.0, 0.0, 0.095)  # the palm in the frame of the arm's flange [m]
_OPEN = [*[0.0] * 12, 0.263, 0.0, 0.0, 0.0]  # joints of the hand [rad]
_POSTURE = [0.0, 0.0, 0.0, -pi / 2, 0.0, pi, pi / 4, *_OPEN]  # fingers along x, palm down
_WAITING = [0.5, -0.6, 0.0, -2.3, 0.0, 2.4, pi / 4, *_OPEN]
_CLEARANCE = 0.002  # distance between the hand and what stands in front of it [m]
_STILL, _PATIENCE = 1e-3, 3.0  # error of the joints at which the arm has arrived [rad], and time in which it must [s]


def menagerie_file(folder: Path, name: Path) -> Path:
    """The file of a model in a copy of MuJoCo Menagerie, after a check that it exists."""
    if not (folder / name).is_file():
        raise FileNotFoundError(
            f"{folder / name} does not exist; give a copy of MuJoCo Menagerie, whose folder {name.parent} has the "
            "model (github.com/google-deepmind/mujoco_menagerie)"
        )
    return folder / name


@dataclass(frozen=True)
class Surroundings:
    """Bodies that a press simulates besides pad and object.

    ``parked`` shapes are beside the pad, each on its guide at nominal size, with None for a free place; with any, a
    finger carries the pad above a table. ``menagerie`` is a copy of MuJoCo Menagerie, of which a Panda arm holds the
    Allegro hand behind the pad; None for no robot.
    """

    parked: tuple[Shape | None, ...] = ()
    menagerie: Path | None = None

    def __post_init__(self) -> None:
        if self.menagerie is not None:
            for name in (_PANDA, ALLEGRO):
                menagerie_file(self.menagerie, name)

    def beside(self, shape: Shape) -> Surroundings:
        """The surroundings of a pressed shape, whose place is free."""
        return replace(self, parked=tuple(None if other == shape else other for other in self.parked))

    def __call__(self, spec: mujoco.MjSpec, pad: Pad) -> None:
        """Add all bodies to the model of a press; see :data:`activetouch.pressing.rig.Around`."""
        world, back, geom = spec.worldbody, -2 * pad.half_thickness, mujoco.mjtGeom
        if self.parked:
            x, y, _ = (_PARKING + _PITCH * len(self.parked)) / 2
            size, place = [0.2, y, 0.01], [x, y - 0.05, -_HEIGHT]
            world.add_geom(name="table", type=geom.mjGEOM_PLANE, size=size, pos=place, rgba=_WOOD, **NO_CONTACT)
            for half, height in ((_TIP, 0.0), (_BASE, _BASE[2] - _HEIGHT)):
                place = [back - half[0], 0.0, height]
                world.add_geom(type=geom.mjGEOM_BOX, size=half, pos=place, rgba=_GREY, **NO_CONTACT)
                back -= 2 * half[0]
        for number, shape in enumerate(self.parked):
            if shape is not None:
                guide = add_guide(spec, f"guide{number}", _PARKING + number * _PITCH)
                add_solid(spec, guide, f"parked{number}", shape.geom, 1.0, mass=0.5, rgba=_BLUE, **NO_CONTACT)
        if self.menagerie is not None:
            arm, reach = _robot(self.menagerie, spec)
            state = [0.0] * len(spec.joints) + _POSTURE
            spec.attach(arm, prefix="robot_", frame=world.add_frame(pos=[back - _CLEARANCE, 0.0, 0.0] - reach))
            spec.add_key(qpos=state, ctrl=state)

    def arrival(self, rig: Rig) -> list[Floats]:
        """Joint positions in every step in which the arm brings the hand by its servos; none without a robot."""
        data, states, joints = copy(rig.data), list[Floats](), slice(-len(_POSTURE), None)
        if self.menagerie is not None:
            data.qpos[joints] = _WAITING
        while np.abs(data.qpos[joints] - rig.data.qpos[joints]).max() > _STILL and data.time < _PATIENCE:
            mujoco.mj_step(rig.model, data)
            states.append(data.qpos.copy())
        return states


def _robot(menagerie: Path, spec: mujoco.MjSpec) -> tuple[mujoco.MjSpec, Floats]:
    """The arm with its hand and the options of ``spec``, and the point of its frame before the middle finger [m]."""
    arm, hand = (mujoco.MjSpec.from_file(str(menagerie / name)) for name in (_PANDA, ALLEGRO))
    flange, palm = arm.site("attachment_site"), hand.worldbody.first_body()
    if flange is None or palm is None or len(arm.joints) + len(hand.joints) != len(_POSTURE):
        raise InvalidArgument(f"{menagerie} has other models than those of the Panda arm and the right Allegro hand")
    for part in (arm, hand):
        for element in (*part.keys, *part.lights):
            part.delete(element)
        for name in dir(spec.option):
            if not name.startswith("_"):
                setattr(part.option, name, getattr(spec.option, name))
    palm.pos, palm.quat = _MOUNT, [1.0, 0.0, 0.0, 0.0]
    arm.attach(hand, prefix="hand_", site=flange)
    for geom in arm.geoms:
        geom.contype = geom.conaffinity = 0
    model = arm.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = _POSTURE
    mujoco.mj_kinematics(model, data)
    along, boxes = data.geom_xmat[:, :3], model.geom_aabb  # x axes of the geoms' frames, and their bounding boxes
    ends = data.geom_xpos[:, 0] + (along * boxes[:, :3]).sum(1) + (np.abs(along) * boxes[:, 3:]).sum(1)
    return arm, np.array([ends.max(), *data.body("hand_mf_tip").xpos[1:]])
