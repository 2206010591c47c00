"""A robot behind the tactile pad, from a checkout of MuJoCo Menagerie: there to be seen and bumped into.

The pad is fixed in the world, so no joint of the robot has anything to do during a press. The robot is therefore a
statue: the joint angles of its pose are worked into its shape, its joints and actuators are left out, and all its geoms
are fixed to the world. It stands perfectly still whatever the controls are, adds no degree of freedom, and leaves the
dynamics of a press bit for bit what they are without it, until the object really meets it.
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

_PREFIX = "robot_"  # of the names of all that is the robot's
_CLEARANCE = 0.002  # between the robot and the back of what it holds [m]


@dataclass(frozen=True)
class Robot:
    """A robot of a MuJoCo Menagerie checkout that holds the pad on the tip of a finger.

    All joints must be hinges through the origins of their bodies, and bodies be oriented by quaternions, as in the
    models of the default.

    Attributes:
        arm: model of the arm, relative to ``root``; the hand is fixed to its site ``attachment_site``.
        hand: model of the hand, relative to ``root``; its first body is the palm, its fingers along z.
        root: the checkout; None means the environment variable ``MENAGERIE_ROOT``.
        arm_angles: of the arm's joints, from the base on [rad]. By default the home pose of the model with the wrist
            bent so that the fingers point along +x, palm down.
        hand_angles: of the hand's joints, in the order of its model [rad]. By default an open hand, the thumb as open
            as it goes.
        mount: position of the palm's origin in the frame of ``attachment_site`` [m].
        tip: body of the hand that is centred behind the pad.
        collisions: whether an object that misses the pad collides with the robot. The robot never collides with
            itself or the pad: none of them can move.
        jointed: whether its joints and servos are modelled, for a robot that shall move; triples the time of a press.
        visuals: whether to load what is there for the looks alone, for a picture: 36 MB instead of under 1.
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
        """Where the file of a model is.

        Args:
            model: its path in the checkout.

        Raises:
            MissingRobot: no checkout is named, or it has no such file.
        """
        root = self.root or os.environ.get("MENAGERIE_ROOT")
        if root and (path := Path(root) / model).is_file():
            return path
        raise MissingRobot(
            f"no {model} "
            + (f"in {root}" if root else "to be found: neither Robot(root=...) nor MENAGERIE_ROOT names a checkout")
            + ". The robot comes from MuJoCo Menagerie. Get it with `git clone "
            "https://github.com/google-deepmind/mujoco_menagerie`, then set MENAGERIE_ROOT to that folder or pass "
            "Robot(root=...)."
        )


ROBOTS: Mapping[str, Robot] = MappingProxyType({"panda_allegro": Robot()})
"""The robots a scene can be given by name."""


def attach_robot(spec: mujoco.MjSpec, robot: Robot, pad_position: tuple[float, float, float]) -> None:
    """Stand the robot behind the pad, a fingertip just behind the back of the pad or of what carries it.

    The base stays upright and turned as in its model; where it stands follows from the pose, so that nothing of the
    robot is in front of the pad's back. Its geoms are named ``robot_<body>_<number>``, those of the hand
    ``robot_hand_<body>_<number>``. The options of ``spec`` stay as they are, and so do the indices of its bodies,
    joints and actuators, but not those of geoms: objects' come after the world's.

    Args:
        spec: the model of a press, not compiled yet, with nothing but boxes along the axes fixed to the world; changed
            in place.
        robot: the robot.
        pad_position: middle of the pad's face [m].

    Raises:
        MissingRobot: its model files are not there.
        ValueError: the number of angles is not that of the joints, or the models are not as :class:`Robot` demands.
    """
    import mujoco

    arm = mujoco.MjSpec.from_file(str(robot.find(robot.arm)))
    hand = mujoco.MjSpec.from_file(str(robot.find(robot.hand)))
    for part, angles in ((arm, robot.arm_angles), (hand, robot.hand_angles)):
        _pose(part, angles)
        for element in (*part.keys, *part.lights, *([] if robot.jointed else [*part.actuators, *part.joints])):
            part.delete(element)
        for name in dir(spec.option):
            if not name.startswith("_"):  # MuJoCo keeps the options of ``spec``, but warns of those that differ
                setattr(part.option, name, getattr(spec.option, name))
    palm = hand.worldbody.first_body()
    palm.pos, palm.quat = robot.mount, [1.0, 0.0, 0.0, 0.0]
    arm.attach(hand, prefix="hand_", site=arm.site("attachment_site"))
    if not (robot.visuals or robot.jointed):  # what moves has its mass from its looks
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
    turned = np.abs(data.geom_xmat[:, :3])  # how far each half-extent of a geom's bounding box reaches along x
    centre = data.geom_xpos[:, 0] + np.einsum("ij,ij->i", data.geom_xmat[:, :3], model.geom_aabb[:, :3])
    front = (centre + np.einsum("ij,ij->i", turned, model.geom_aabb[:, 3:])).max()
    back = min(geom.pos[0] - geom.size[0] for geom in spec.worldbody.geoms)
    base = np.array([back - _CLEARANCE - front, *(pad_position[1:] - data.body(f"hand_{robot.tip}").xpos[1:])])
    for number, geom in enumerate(arm.geoms):
        geom.name = f"{geom.parent.name}_{number}"
    if not robot.jointed:
        for exclusion in arm.excludes:
            arm.delete(exclusion)  # their mention of bodies would keep those from being fused
        arm.fuse_static()  # with the world, which costs a step less than even a single body of its own
    spec.attach(arm, prefix=_PREFIX, frame=spec.worldbody.add_frame(pos=base))


def _pose(spec: mujoco.MjSpec, angles: tuple[float, ...]) -> None:
    """Make the angles of the joints [rad] the pose that the model is reset to, whether the joints stay or not."""
    import mujoco

    if any(body.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT for body in spec.bodies):
        raise ValueError(f"{spec.modelname} orients a body by something else than a quaternion")
    if len(angles) != len(spec.joints):
        raise ValueError(f"{spec.modelname} has {len(spec.joints)} joints, got {len(angles)} angles")
    for joint, angle in zip(spec.joints, angles, strict=True):
        if joint.type != mujoco.mjtJoint.mjJNT_HINGE or np.any(joint.pos):
            raise ValueError(f"joint {joint.name} of {spec.modelname} is no hinge through the origin of its body")
        body, turn, turned = joint.parent, np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, joint.axis, angle)
        mujoco.mju_mulQuat(turned, body.quat / np.linalg.norm(body.quat), turn)
        body.quat, joint.ref = turned, np.rad2deg(angle) if spec.compiler.degree else angle
