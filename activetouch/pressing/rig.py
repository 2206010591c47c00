"""The MuJoCo model of a press: a pad with a soft contact, and an object on a linear guide.

It has two geoms, one slide joint, one contact pair and no gravity. Each shape has its own model. A model is compiled
once, at the largest size; a press sets size, orientation and offset in place, so that MuJoCo's bounding volumes remain
valid.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch.errors import WrongMujoco
from activetouch.poses import Placement
from activetouch.pressing.contact import Pad, Phase, Trace
from activetouch.solids.solid import Geom, Shape

_OLDEST = (4, 0, 1)
if tuple(int(part) for part in mujoco.__version__.split(".")[:3]) < _OLDEST:
    raise WrongMujoco(
        f"MuJoCo {mujoco.__version__} is installed; 4.0.1 or newer is needed (older cylinder-edge contacts are "
        "faulty). A package that depends on `mujoco` may have overwritten `mujoco-core`. Repair: "
        "pip uninstall -y mujoco mujoco-core && pip install 'mujoco-core>=4.0.1,<5'"
    )

_MASS = 0.5  # mass of object and guide together [kg]; with the pad's contact it gives 1.5-2.4 mm at 2 N
SERVO_STIFFNESS = 20_000.0  # stiffness of position servos [N/m]
PAD_SOLIMP = (0.7, 0.9, 0.003, 0.5, 2.0)  # impedance from 0.7 to 0.9 over 3 mm
LARGEST_SCALE = 2.0
"""Size at which an object is compiled, relative to nominal: the largest size of a press."""
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # all that determines the next step
_CLEAREST = 0.0005  # smallest distance between pad and object after a skipped approach [m]
_TRANSIENT = 8.0  # duration of the transient of the servo, relative to its lag: its error is then e^-16 of its first
_DARK, ORANGE = (0.15, 0.16, 0.2, 1), (0.9, 0.45, 0.1, 1)
NO_CONTACT = {"contype": 0, "conaffinity": 0}  # except of pairs
FORCE, _POSITION, _NET_FORCE = 1 << 1, 1 << 4, 3  # settings of MuJoCo's contact sensor


Around: TypeAlias = Callable[[mujoco.MjSpec, Pad], None]
"""Adds what stands around pad and object, without contacts, after the bodies of a press."""


def build_spec(
    pad: Pad, geom: Geom, timestep: float, traced: bool = False, largest_scale: float = LARGEST_SCALE
) -> mujoco.MjSpec:
    """The model of a pad and one object at its largest size, not compiled; see :class:`Rig` for the arguments."""
    spec = mujoco.MjSpec()
    set_options(spec, timestep)
    add_pad(spec.worldbody, "pad", pad, rgba=_DARK)
    guide = add_guide(spec, "guide")
    body = guide.add_body(name="object")  # its own body, so that its orientation does not turn the guide
    add_solid(spec, body, "object", geom, largest_scale, mass=_MASS, rgba=ORANGE, **NO_CONTACT)
    softness = [pad.contact_time, pad.damping_ratio]
    spec.add_pair(name="touch", geomname1="pad", geomname2="object", solref=softness, solimp=PAD_SOLIMP)
    if traced:
        add_sensor(spec, "pad", FORCE | _POSITION)
    return spec


def add_guide(spec: mujoco.MjSpec, name: str, place: ArrayLike = (0.0, 0.0, 0.0)) -> mujoco.MjsBody:
    """Add a body that a servo moves along x, for an object."""
    guide = spec.worldbody.add_body(name=name, pos=place)
    guide.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=SERVO_STIFFNESS, dampratio=1.0)
    return guide


def set_options(spec: mujoco.MjSpec, timestep: float) -> None:
    """Give a model the settings of all presses: no gravity, because guide or palm carry the object."""
    spec.option.timestep = timestep
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_ISLAND  # a tenth of the time of a step of one body


def add_pad(
    body: mujoco.MjsBody, name: str, pad: Pad, place: Sequence[float] = (0.0, 0.0, 0.0), **properties: object
) -> None:
    """Add a pad to a body with its face at a place [m], with further properties of a MuJoCo geom."""
    size = [pad.half_thickness, pad.half_width, pad.half_width]
    centre, kind = [place[0] - pad.half_thickness, *place[1:]], mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(name=name, type=kind, size=size, pos=centre, **NO_CONTACT, **properties)


def add_sensor(spec: mujoco.MjSpec, pad: str, data: int) -> None:
    """Add a sensor of all contacts of a pad together; ``data`` says of what, as bits."""
    kind, geom = mujoco.mjtSensor.mjSENS_CONTACT, mujoco.mjtObj.mjOBJ_GEOM
    sensor = spec.add_sensor(name=pad, type=kind, objtype=geom, objname=pad)
    sensor.intprm[:3] = [data, _NET_FORCE, 1]


def add_solid(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, geom: Geom, scale: float, **properties: object
) -> None:
    """Add the geom of a shape at a scale to a body, with further properties of a MuJoCo geom."""
    if geom.vertices is not None:
        spec.add_mesh(name=name, uservert=(geom.vertices * scale).ravel())
        properties["meshname"] = name
    else:
        properties["size"] = np.asarray(geom.size) * scale
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{geom.type.upper()}")
    body.add_geom(name=name, type=kind, **properties)


@cache
def stop_clock() -> None:
    """Stop MuJoCo from measuring times in this process, which takes a fifth of a press; ``mjData.timer`` then reads 0.

    The Python package gives MuJoCo a clock, which every step reads some thirty times. It is taken away where the
    library is found beside the package. ``mujoco.set_mjcb_time`` sets another.
    """
    for path in Path(mujoco.__file__).parent.glob("*mujoco.*"):
        try:
            clock = ctypes.c_void_p.in_dll(ctypes.CDLL(str(path)), "mjcb_time")
        except (OSError, ValueError):  # not the library, or one without this variable
            continue
        clock.value = None


class Rig:
    """A compiled model of a pad and one object, which can be placed and pressed many times.

    For pictures, ``largest_scale`` must be the placed size, as rays are tested against bounding volumes of that size.
    """

    def __init__(
        self,
        pad: Pad,
        geom: Geom,
        timestep: float,
        traced: bool = False,
        largest_scale: float = LARGEST_SCALE,
        around: Around | None = None,
    ) -> None:
        stop_clock()
        spec = build_spec(pad, geom, timestep, traced, largest_scale)
        if around is not None:
            around(spec, pad)
        self.model = spec.compile()
        self._largest_scale = largest_scale
        self.data = mujoco.MjData(self.model)
        if self.model.nkey:  # where the robot stands
            mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self._fresh = np.empty(mujoco.mj_stateSize(self.model, _STATE))  # state of a model that was never stepped
        mujoco.mj_getState(self.model, self.data, self._fresh, _STATE)
        self._traced = traced
        self._body, self._geom = self.model.body("object").id, self.model.geom("object").id
        mesh = self.model.geom_dataid[self._geom]
        first, count = (self.model.mesh_vertadr[mesh], self.model.mesh_vertnum[mesh]) if mesh >= 0 else (0, 0)
        # MuJoCo places a mesh relative to the centre of mass of its body, so this is scaled too.
        scaled = self.model.geom_size[self._geom], self.model.geom_pos[self._geom], self.model.body_ipos[self._body]
        self._largest = [(one, one.copy()) for one in (*scaled, self.model.mesh_vert[first : first + count])]
        joint = self.model.joint("guide")
        self._position = self.data.qpos[joint.qposadr[0] :]
        self._velocity = self.data.qvel[joint.dofadr[0] :]
        # A memory view gives its numbers as floats, which calculate faster than the scalars of an array.
        self.reaction = memoryview(self.data.qfrc_constraint)[joint.dofadr[0] :]
        """Its first number is the constraint force on the guide [N]."""
        self._warnings = self.data.warning.number
        actuator = self.model.actuator("guide")
        self.command = self.data.ctrl[actuator.id :]
        """Its first number is the position to which the guide is commanded [m]."""
        self._lag = -float(actuator.biasprm[2] / actuator.gainprm[0])  # lag of the servo behind its command [s]
        self._rows: list[tuple[Phase, float, NDArray[np.float64]]] = []
        self._num_skipped = 0  # steps before the first row

    def place(self, position: float, placement: Placement) -> None:
        """Put the object at rest with its centre ``position`` [m] in front of the pad."""
        factor = placement.scale / self._largest_scale
        if not 0.0 < factor <= 1.0:
            raise ValueError(f"scale must be in (0, {self._largest_scale}], got {placement.scale}")
        model = self.model
        mujoco.mj_setState(model, self.data, self._fresh, _STATE)  # a twentieth of the time of mj_resetData
        self._warnings[:] = 0
        self._rows.clear()
        self._num_skipped = 0
        for scaled, largest in self._largest:
            scaled[:] = largest * factor
        model.pair_friction[0, :2] = placement.friction
        model.body_pos[self._body, 1:] = placement.offset
        model.body_quat[self._body] = placement.orientation
        self._position[0] = self.command[0] = position

    def skip_approach(self, position: float, speed: float, nearest: float) -> int:
        """Move the object near the pad, in the motion that it would have there; return the number of skipped steps.

        The servo follows a command of constant velocity at a constant distance once its transient has decayed. All
        steps of the free approach after that are alike, so that their end is known without them. Nothing is skipped
        where the approach is no longer than the transient. Positions of the centre are in [m]: ``position``, where the
        object was placed at rest, and ``nearest``, where it touches the pad, ``nan`` for a miss.
        """
        timestep = self.model.opt.timestep
        step, gap = timestep * speed, _CLEAREST
        while position - nearest > gap:  # False for a miss
            behind = speed * self._lag - step
            num_steps = int((position + behind - nearest - gap) / step)
            if num_steps * timestep <= _TRANSIENT * self._lag:
                break
            self._position[0] = position - num_steps * step + behind
            self._velocity[0] = -speed
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_collision(self.model, self.data)
            if self.data.ncon == 0:  # a tip between taxels, or the convex hull of a hollow, could touch before
                self._num_skipped = num_steps
                return num_steps
            gap *= 4.0
        self._position[0], self._velocity[0] = position, 0.0
        return 0

    def step(self, position: float, phase: Phase) -> float:
        """Command the guide to a position [m], simulate one timestep, and return the normal force [N]."""
        self.command[0] = position
        mujoco.mj_step(self.model, self.data)
        if self._traced:
            self._rows.append((phase, self._position[0], self.data.sensordata.copy()))
        return self.force

    def relabel(self, num_steps: int, phase: Phase) -> None:
        """Correct the phase of the last steps."""
        self._rows[-num_steps:] = [(phase, x, sensed) for _, x, sensed in self._rows[-num_steps:]]

    def trace(self) -> Trace | None:
        """The trace since the object was placed, or since the end of the skipped approach; None if not traced."""
        if not self._traced:
            return None
        phases, along, rows = zip(*self._rows, strict=True)
        sensed = np.array(rows)
        time = self.model.opt.timestep * np.arange(self._num_skipped + 1, self._num_skipped + len(rows) + 1)
        position = np.tile([0.0, *self.model.body_pos[self._body, 1:]], (len(rows), 1))
        position[:, 0] = along
        force = sensed[:, :3]
        point = np.where(force.any(axis=1, keepdims=True), sensed[:, 4:6], 0.0)
        return Trace(time, position, force, point, phases)

    @property
    def force(self) -> float:
        """Normal force between pad and object [N], the constraint force on the guide; 0 behind the pad's rim."""
        return max(float(self.reaction[0]), 0.0)

    @property
    def num_warnings(self) -> int:
        """MuJoCo warnings since the object was placed."""
        return int(self._warnings.sum())


@lru_cache(maxsize=64)
def shared_rig(pad: Pad, shape: Shape, timestep: float, traced: bool, around: Around | None = None) -> Rig:
    """The cached rig of this process; a press does not depend on earlier ones, but only one can run at a time."""
    return Rig(pad, shape.geom, timestep, traced, around=around)
