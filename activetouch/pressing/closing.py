"""Grasps simulated step by step in MuJoCo: fingers close on one body, which is free to move and to turn.

>>> from activetouch import SCENES
>>> scene, rng = SCENES["coarse"].scene.with_hand("three_finger", Closing()), np.random.default_rng(0)
>>> grasp = scene.press(scene.sample_object("sphere", rng), "front", rng)
>>> [contact.force > 1.0 for contact in grasp.contacts]
[True, True, True]
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.errors import UnstablePress
from activetouch.poses import Placement, to_matrix
from activetouch.pressing.contact import Grasp, Pad, elastic_contact, first_touch, missed
from activetouch.pressing.dynamic import Dynamic, facing_geom
from activetouch.pressing.rig import (
    FORCE,
    NO_CONTACT,
    ORANGE,
    PAD_SOLIMP,
    SERVO_STIFFNESS,
    add_pad,
    add_sensor,
    add_solid,
    set_options,
    stop_clock,
)
from activetouch.solids.solid import Floats
from belief.constraints import Within, require_rule

Watch = Callable[[mujoco.MjModel, mujoco.MjData], None]

BODY_MASS = 0.1  # [kg]
_MOST_FORCE = 50.0  # largest force of a sliding finger's servo [N]
_TORSION = 0.003  # friction of a pad's contact against turning about its normal, relative to that against sliding [m]
_STICKS = (0.004, 1.0)  # settings of that friction: soft friction lets a body creep
_LIGHT = 0.05  # force that a finger keeps until the others touch, too [N]
_SERVO = Within(0.0, _MOST_FORCE, unit=" N")
_GRIP = Within(1e-6, 1e3, unit=" N m")
_CALM = 0.001  # speed of a body that rests [m/s]
_BLUE = (0.3, 0.5, 0.75, 1)


class Gripper(ABC):
    """A compiled model of m fingers, with the geoms ``pad0``, ``pad1``, … and a body ``object`` between them.

    :func:`add_finger_pad` and :func:`add_body` must have changed ``spec``. ``radius`` of the body and the distance
    ``open_at`` of the pads' faces from the palm's centre are in [m]. ``in_unison``: all fingers squeeze by the same
    distance, until their mean force is right. ``camera``: middle of a picture and distance of the camera [m].
    """

    in_unison: ClassVar[bool] = False
    camera: ClassVar[tuple[tuple[float, float, float], float]] = (0.0, 0.0, 0.0), 0.25

    def __init__(self, spec: mujoco.MjSpec, law: Closing, pad: Pad, radius: float, open_at: float) -> None:
        stop_clock()
        set_options(spec, law.timestep)
        spec.option.impratio = 10.0
        spec.option.noslip_iterations = 3  # else bodies creep
        self.model, self.pad, self.open_at = spec.compile(), pad, open_at
        self.data = mujoco.MjData(self.model)
        self._pads = [self.model.geom(f"pad{number}").id for number in range(self.model.nsensor)]
        self._body, self._radius = self.model.body("object").id, radius
        first, free = self.model.body_dofadr[self._body], self.model.body_dofnum[self._body]
        slides = free - 3 if self.model.body_jntnum[self._body] == 1 else free
        shifts, turns = slice(first, first + slides), slice(first + slides, first + free)
        self.model.dof_damping[shifts], self.model.dof_damping[turns] = law.damping, law.damping * (radius / 2) ** 2
        self.model.dof_frictionloss[turns] = law.grip or 0.0
        self._shifting, self._turning = self.data.qvel[shifts], self.data.qvel[turns]
        mujoco.mj_forward(self.model, self.data)

    def __len__(self) -> int:
        return len(self._pads)

    @abstractmethod
    def advance(self, moves: Floats) -> None:
        """Command each pad along its own axis by a distance, ``(m,)`` [m]."""

    @abstractmethod
    def stop(self, fingers: NDArray[np.bool_]) -> None:
        """Command fingers to stay where they are, those of a mask ``(m,)``."""

    @property
    def forces(self) -> Floats:
        """Force of each pad on the body, in the world's frame, ``(m, 3)`` [N]."""
        return self.data.sensordata.reshape(-1, 3)

    @property
    def rotations(self) -> Floats:
        """Rotation matrices of the pads, ``(m, 3, 3)``; their first columns are the axes."""
        return self.data.geom_xmat[self._pads].reshape(-1, 3, 3)

    @property
    def faces(self) -> Floats:
        """Centres of the pads' faces, ``(m, 3)`` [m]."""
        return self.data.geom_xpos[self._pads] + self.pad.half_thickness * self.rotations[:, :, 0]

    @property
    def speed(self) -> float:
        """Largest speed of the body's surface [m/s]."""
        shifting, turning = (np.abs(part).max(initial=0.0) for part in (self._shifting, self._turning))
        return float(shifting + self._radius * turning)

    def met(self, placement: Placement) -> tuple[list[Placement], Floats]:
        """See :func:`in_front`."""
        body = self.data.xpos[self._body], self.data.xmat[self._body].reshape(3, 3)
        return in_front(self.faces, self.rotations, *body, placement)


def in_front(
    faces: Floats, rotations: Floats, position: Floats, turned: Floats, placement: Placement
) -> tuple[list[Placement], Floats]:
    """The body in the frames of pads, and the distances of its centre from their faces, ``(m,)`` [m].

    The pads' ``faces (m, 3)`` [m] and ``rotations (m, 3, 3)``, and the body's centre ``position (3,)`` [m] and rotation
    ``turned (3, 3)`` are in one common frame.
    """
    found, centres = [], np.einsum("mij,mi->mj", rotations, position - faces)
    for rotation, centre in zip(rotations, centres, strict=True):
        found.append(replace(placement, orientation=to_quaternion(rotation.T @ turned), offset=centre[1:]))
    return found, centres[:, 0]


def add_finger_pad(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, number: int, pad: Pad, place: Sequence[float], mass: float = 0.1
) -> None:
    """Add a pad to the last segment of a finger, with its face at a place [m], and a sensor of its force."""
    add_pad(body, f"pad{number}", pad, place, mass=mass, rgba=_BLUE)
    add_sensor(spec, f"pad{number}", FORCE)


def to_quaternion(rotation: Floats) -> Floats:
    """The unit quaternion ``wxyz`` of a rotation matrix."""
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, rotation.ravel())
    return found


def add_body(spec: mujoco.MjSpec, turned: Floats, centre: Floats, pad: Pad, met: Sequence[Placement]) -> mujoco.MjsBody:
    """Add a body without joints that only the pads touch, with a rotation, ``(3, 3)``, and a centre, ``(3,)`` [m].

    ``met`` is what each finger has in front of it; it stands for a hollow body there.
    """
    placement, orientation = met[0], to_quaternion(turned)
    body, scale = spec.worldbody.add_body(name="object", pos=centre, quat=orientation), placement.scale
    add_solid(spec, body, "object", placement.shape.geom, scale, mass=BODY_MASS, rgba=ORANGE, **NO_CONTACT)
    softness, slides = [pad.contact_time, pad.damping_ratio], placement.friction
    friction = [slides, slides, _TORSION * slides, 1e-4, 1e-4]
    for number, seen in enumerate(met):
        facing, name = facing_geom(pad, seen, *first_touch(pad, seen)), "object"
        if facing is not None:
            name = f"facing{number}"
            add_solid(spec, body, name, facing, scale, mass=0.0, group=4, rgba=(0, 0, 0, 0), **NO_CONTACT)
        pair = spec.add_pair(name=f"touch{number}", geomname1=f"pad{number}", geomname2=name, condim=4)
        pair.friction, pair.solref, pair.solimp = friction, softness, PAD_SOLIMP
        pair.solreffriction = _STICKS
    return body


class SlidingPads(Gripper):
    """Pads that slide along their axes in the frame of the palm."""

    def __init__(self, law: Closing, pad: Pad, met: Sequence[Placement], fingers: Floats, centre: Floats) -> None:
        spec, radius = mujoco.MjSpec(), met[0].bounding_radius
        open_at = max(law.start, float(np.linalg.norm(centre)) + radius + pad.max_depth)
        for number, rotation in enumerate(fingers):
            name = f"finger{number}"
            carriage = spec.worldbody.add_body(name=name, quat=to_quaternion(rotation))
            carriage.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
            add_finger_pad(spec, carriage, number, pad, (-open_at, 0.0, 0.0))
            servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            servo.set_to_position(kp=SERVO_STIFFNESS, dampratio=1.0)
            servo.forcerange = [-_MOST_FORCE, _MOST_FORCE]
        body = add_body(spec, fingers[0] @ to_matrix(met[0].orientation), centre, pad, met)
        if len(met) == 1:
            body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)  # the palm holds its place
        elif law.turns:
            body.add_freejoint()
        else:
            for axis in np.eye(3):
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        super().__init__(spec, law, pad, radius, open_at)

    def advance(self, moves: Floats) -> None:
        """See :class:`Gripper`."""
        self.data.ctrl[:] += moves

    def stop(self, fingers: NDArray[np.bool_]) -> None:
        """See :class:`Gripper`."""
        self.data.ctrl[fingers] = self.data.qpos[: len(self)][fingers]


@dataclass(frozen=True)
class Closing(Dynamic):
    """Position-controlled fingers that close on a body until each has its force.

    Each finger advances along its axis and keeps a light touch until all others touch or are at their end. Then all
    squeeze: the velocity is proportional to the force error, up to ``speed``. The grasp ends when the errors of all
    fingers that touch have stayed within the tolerance, and the body at rest, for the whole ``pause``. A finger that
    meets nothing ends behind the body's centre. The body is in the palm, which slows it down and carries its weight.
    For a single pad the palm also holds the body's place, and its orientation too unless there is a ``grip``.

    Attributes:
        timestep, speed, admittance, tolerance, pause, patience, start, travel, traced: as of :class:`Dynamic`, of a
            finger; ``start`` is the distance of each pad's face from the palm's centre.
        turns: whether the body can turn; else the palm holds its orientation, as in a quasistatic grasp.
        damping: force per velocity by which the palm slows the body down [N s/m].
        grip: torque up to which the palm holds the body's orientation, so that a press beside its middle or on a slope
            may turn it [N m]; None for no such friction.
    """

    closes: ClassVar[bool] = True

    admittance: float = 0.04
    turns: bool = True
    damping: float = 10.0
    grip: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.grip is not None:
            require_rule("grip", self.grip, _GRIP)

    def lets_turn(self, num_fingers: int) -> bool:
        """See :class:`activetouch.pressing.contact.Press`."""
        return self.turns and (num_fingers > 1 or self.grip is not None)

    def close(
        self, pad: Pad, met: Sequence[Placement], fingers: Floats, centre: Floats, forces: Sequence[float]
    ) -> Grasp:
        """See :class:`activetouch.pressing.contact.Press`."""
        if len(met) == 1 and not self.lets_turn(1):  # the palm holds the body
            return super().close(pad, met, fingers, centre, forces)
        for force in forces:
            require_rule("target_force", force, _SERVO)
        return self.settle(SlidingPads(self, pad, met, fingers, centre), met[0], np.asarray(forces, float))

    def settle(self, gripper: Gripper, placement: Placement, forces: Floats, watch: Watch | None = None) -> Grasp:
        """Close the fingers until they and the body rest; ``forces (m,)`` [N]; ``watch`` is called after every step."""
        model, data, pad = gripper.model, gripper.data, gripper.pad
        faces, axes = gripper.faces, gripper.rotations[:, :, 0]
        met, distances = gripper.met(placement)
        touching = np.array([first_touch(pad, seen)[1] for seen in met])
        end = distances + self.travel - np.fmin(touching, 0.0)
        advance, gain = self.timestep * self.speed, self.timestep * self.admittance
        wanted, longest = self.pause / self.timestep, (self.patience + end.max() / self.speed) / self.timestep
        moved, touched, num_settled, squeezes = np.zeros(len(gripper)), np.zeros(len(gripper), bool), 0, False
        for _ in range(round(longest)):
            felt = np.einsum("mi,mi->m", gripper.forces, gripper.rotations[:, :, 0])
            touches = felt > 0.0
            if not squeezes and (touches & ~touched).any():
                gripper.stop(touches & ~touched)
            touched |= touches
            squeezes = squeezes or bool((touches | (moved >= end)).all())
            errors = (forces if squeezes else np.fmin(forces, _LIGHT)) - felt
            if squeezes and gripper.in_unison:
                errors[:] = errors.mean()
            rests = np.abs(errors) <= self.tolerance * forces
            eager = ~touches & ~(gripper.in_unison & squeezes)
            moves = np.where(rests, 0.0, np.clip(gain * errors, -advance, advance))
            moves = np.fmin(np.where(eager, advance, moves), end - moved)
            calm = squeezes and gripper.speed < _CALM and rests[touches].all()
            num_settled = num_settled + 1 if calm else 0
            if num_settled > wanted:
                break
            gripper.advance(moves)
            moved += moves
            mujoco.mj_step(model, data)
            if watch is not None:
                watch(model, data)
        if num_settled <= wanted or data.warning.number.sum():
            raise UnstablePress(
                f"grasping {placement}: the forces did not settle at {forces.round(3).tolist()} N (last "
                f"{felt.round(3).tolist()} N). Try a smaller timestep or speed, or more patience, than in {self}."
            )
        met, distances = gripper.met(placement)
        contacts = []
        for seen, normal in zip(met, felt.tolist(), strict=True):
            gap, _ = first_touch(pad, seen)
            is_met = normal > 0.0 and np.isfinite(gap.min())
            contacts.append(elastic_contact(pad, gap, normal, placement.stiffness) if is_met else missed(pad))
        centre = distances - gripper.open_at + np.einsum("mi,mi->m", gripper.faces - faces, axes)
        return Grasp(tuple(contacts), tuple(met), centre, gripper.forces.sum(axis=0))
