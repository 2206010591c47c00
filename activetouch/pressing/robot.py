"""A static robot behind the tactile pad, from a checkout of MuJoCo Menagerie, for pictures and collisions.

The pad is fixed in the world, so the robot does not move in a press: its joints and actuators are removed and its geoms
are fixed to the world in its pose. It adds no degree of freedom and changes a press only if the object collides with it
(decision 0010).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from activetouch.errors import MissingRobot

if TYPE_CHECKING:
    import mujoco

_PREFIX = "robot_"  # of the names of the robot's parts
_CLEARANCE = 0.002  # between the robot and the back of the pad or finger [m]


@dataclass(frozen=True)
class Robot:
    """A robot of a MuJoCo Menagerie checkout that holds the pad on the tip of a finger.

    All joints must be hinges through the origins of their bodies, with orientations given by quaternions.

    Attributes:
        arm: model of the arm, relative to ``root``; the hand is fixed to its site ``attachment_site``.
        hand: model of the hand, relative to ``root``; its first body is the palm, with the fingers along z.
        root: the checkout; None means the environment variable ``MENAGERIE_ROOT``.
        arm_angles: of the arm's joints, from the base on [rad]; by default the fingers point along +x, palm down.
        hand_angles: of the hand's joints, in the order of its model [rad]; by default the hand is open.
        mount: position of the palm's origin in the frame of ``attachment_site`` [m].
        tip: body of the hand that is centred behind the pad.
        collisions: whether an object that misses the pad collides with the robot.
        jointed: whether to model joints and servos, which triples the time of a press.
        visuals: whether to load visual meshes, for pictures: 36 MB instead of under 1.
    """

    arm: str = "franka_emika_panda/panda_nohand.xml"
    hand: str = "wonik_allegro/right_hand.xml"
    root: Path | None = None
    arm_angles: tuple[float, ...] = (0.0, 0.0, 0.0, -pi / 2, 0.0, pi, pi / 4)
    hand_angles: tuple[float, ...] = (0.0,) * 12 + (0.263, 0.0, 0.0, 0.0)
    mount: tuple[float, float, float] = (0.0, 0.0, 0.095)
    tip: str = "mf_tip"
    collisions: bool = True
    jointed: bool = False
    visuals: bool = False

    def find(self, model: str) -> Path:
        """Path of the file of a model, given by its path in the checkout.

        Raises:
            MissingRobot: there is no checkout, or it has no such file.
        """
        root = self.root or os.environ.get("MENAGERIE_ROOT")
        if root and (path := Path(root) / model).is_file():
            return path
        raise MissingRobot(
            f"no {model} "
            + (f"in {root}" if root else "found: neither Robot(root=...) nor MENAGERIE_ROOT names a checkout")
            + ". The robot is part of MuJoCo Menagerie. Get it with `git clone "
            "https://github.com/google-deepmind/mujoco_menagerie`, then set MENAGERIE_ROOT or pass Robot(root=...)."
        )


ROBOTS: Mapping[str, Robot] = MappingProxyType({"panda_allegro": Robot()})
"""The robots by name."""


def attach_robot(spec: mujoco.MjSpec, robot: Robot, pad_position: tuple[float, float, float]) -> None:
    """Add the robot to a model, with a fingertip behind the pad and no part in front of the pad's back.

    The geoms are named ``robot_<body>_<number>``, those of the hand ``robot_hand_<body>_<number>``. The options of
    ``spec`` and the indices of its bodies, joints and actuators stay the same; the indices of geoms change.

    Args:
        spec: the model of a press, changed in place; its world must have only axis-aligned boxes.
        robot: the robot.
        pad_position: middle of the pad's face [m].

    Raises:
        MissingRobot: its model files are missing.
        ValueError: the number of angles is wrong, or the models violate the rules of :class:`Robot`.
    """
    import mujoco

    arm = mujoco.MjSpec.from_file(str(robot.find(robot.arm)))
    hand = mujoco.MjSpec.from_file(str(robot.find(robot.hand)))
    for part, angles in ((arm, robot.arm_angles), (hand, robot.hand_angles)):
        _pose(part, angles)
        for element in (*part.keys, *part.lights, *([] if robot.jointed else [*part.actuators, *part.joints])):
            part.delete(element)
        for name in dir(spec.option):
            if not name.startswith("_"):  # different options would cause warnings
                setattr(part.option, name, getattr(spec.option, name))
    palm = hand.worldbody.first_body()
    palm.pos, palm.quat = robot.mount, [1.0, 0.0, 0.0, 0.0]
    arm.attach(hand, prefix="hand_", site=arm.site("attachment_site"))
    if not (robot.visuals or robot.jointed):  # jointed bodies take their mass from visual geoms
        for geom in arm.geoms:
            if geom.contype == geom.conaffinity == 0:
                arm.delete(geom)
        arm.discard_visual()  # their meshes and materials
    if not robot.collisions:
        for geom in arm.geoms:
            geom.contype = geom.conaffinity = 0
    model = arm.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turned = np.abs(data.geom_xmat[:, :3])  # of each half-extent of a geom's bounding box, its part along x
    centre = data.geom_xpos[:, 0] + np.einsum("ij,ij->i", data.geom_xmat[:, :3], model.geom_aabb[:, :3])
    front = (centre + np.einsum("ij,ij->i", turned, model.geom_aabb[:, 3:])).max()
    back = min(geom.pos[0] - geom.size[0] for geom in spec.worldbody.geoms)
    base = np.array([back - _CLEARANCE - front, *(pad_position[1:] - data.body(f"hand_{robot.tip}").xpos[1:])])
    for number, geom in enumerate(arm.geoms):
        geom.name = f"{geom.parent.name}_{number}"
    if not robot.jointed:
        for exclusion in arm.excludes:
            arm.delete(exclusion)  # excluded bodies could not be fused
        arm.fuse_static()  # with the world, for the fastest simulation
    spec.attach(arm, prefix=_PREFIX, frame=spec.worldbody.add_frame(pos=base))


def _pose(spec: mujoco.MjSpec, angles: tuple[float, ...]) -> None:
    """Set the reference pose of a model to these joint angles [rad], also if the joints are removed later."""
    import mujoco

    if any(body.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT for body in spec.bodies):
        raise ValueError(f"{spec.modelname} does not orient all bodies by quaternions")
    if len(angles) != len(spec.joints):
        raise ValueError(f"{spec.modelname} has {len(spec.joints)} joints, got {len(angles)} angles")
    for joint, angle in zip(spec.joints, angles, strict=True):
        if joint.type != mujoco.mjtJoint.mjJNT_HINGE or np.any(joint.pos):
            raise ValueError(f"joint {joint.name} of {spec.modelname} is not a hinge through the origin of its body")
        body, turn, turned = joint.parent, np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, joint.axis, angle)
        mujoco.mju_mulQuat(turned, body.quat / np.linalg.norm(body.quat), turn)
        body.quat, joint.ref = turned, np.rad2deg(angle) if spec.compiler.degree else angle
