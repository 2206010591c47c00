"""The minimal MuJoCo model of a press: a soft pad and one object on a linear guide, nothing else.

Two geoms, one slide joint, one contact pair, no gravity, no robot. The model is compiled once per shape, at
the largest size, and each press only rewrites the object's size, orientation and offset in place: MuJoCo's
bounding volumes then stay conservative, and contacts are those of a freshly compiled model.
"""

from __future__ import annotations

import mujoco
import numpy as np

from activetouch.errors import WrongMujoco
from activetouch.pad import Pad
from activetouch.placement import Placement
from activetouch.shapes import Shape

_OLDEST = (4, 0, 1)
if tuple(int(part) for part in mujoco.__version__.split(".")[:3]) < _OLDEST:
    raise WrongMujoco(
        f"MuJoCo {mujoco.__version__} is installed; 4.0.1 or newer is needed (older cylinder-edge contacts are "
        "faulty). A package that depends on `mujoco` may have overwritten `mujoco-core`. Repair: "
        "pip uninstall -y mujoco mujoco-core && pip install 'mujoco-core>=4.0.1,<5'"
    )

_MASS = 0.5  # of object and guide together [kg]; with the pad's solref it gives 1.5-2.4 mm at 2 N
_SERVO_STIFFNESS = 20_000.0  # of the guide's position servo [N/m]
_PAD_SOLREF = (0.04, 1.0)  # time constant [s], damping ratio
_PAD_SOLIMP = (0.7, 0.9, 0.003, 0.5, 2.0)  # impedance from 0.7 to 0.9 over 3 mm
_LARGEST_SCALE = 2.0  # compiled size relative to nominal

_GEOM_TYPES = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "mesh": mujoco.mjtGeom.mjGEOM_MESH,
}


def build_spec(pad: Pad, shape: Shape, timestep: float) -> mujoco.MjSpec:
    """The model of one pad and one object at its largest size, ready to compile."""
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.worldbody.add_geom(
        name="pad",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[pad.half_thickness, pad.half_width, pad.half_width],
        pos=[-pad.half_thickness, 0.0, 0.0],
        solref=_PAD_SOLREF,
        solimp=_PAD_SOLIMP,
        priority=1,  # the pad's softness decides, whatever touches it
    )
    guide = spec.worldbody.add_body(name="guide")
    guide.add_joint(name="guide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    body = guide.add_body(name="object")  # its own body, so that turning it leaves the guide's axis alone
    geom = shape.geom
    if geom.vertices is not None:
        spec.add_mesh(name="object", uservert=(geom.vertices * _LARGEST_SCALE).ravel())
        body.add_geom(name="object", type=_GEOM_TYPES[geom.type], meshname="object", mass=_MASS)
    else:
        size = np.asarray(geom.size) * _LARGEST_SCALE
        body.add_geom(name="object", type=_GEOM_TYPES[geom.type], size=size, mass=_MASS)
    actuator = spec.add_actuator(name="guide", target="guide", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(kp=_SERVO_STIFFNESS, dampratio=1.0)
    return spec


class Rig:
    """A compiled model with one object, placed and stepped press after press."""

    def __init__(self, pad: Pad, shape: Shape, timestep: float) -> None:
        self.model = build_spec(pad, shape, timestep).compile()
        self.data = mujoco.MjData(self.model)
        self._body = self.model.body("object").id
        self._geom = self.model.geom("object").id
        self._control, self._reaction = self.data.ctrl, self.data.qfrc_constraint
        self._largest = {
            "geom_size": self.model.geom_size[self._geom].copy(),
            "geom_pos": self.model.geom_pos[self._geom].copy(),
            "mesh_vert": self.model.mesh_vert.copy(),
        }

    def place(self, position: float, placement: Placement) -> None:
        """Put the object at rest, its centre ``position`` [m] in front of the pad."""
        factor = placement.scale / _LARGEST_SCALE
        if not 0.0 < factor <= 1.0:
            raise ValueError(f"scale must be in (0, {_LARGEST_SCALE}], got {placement.scale}")
        mujoco.mj_resetData(self.model, self.data)
        self.model.geom_size[self._geom] = self._largest["geom_size"] * factor
        self.model.geom_pos[self._geom] = self._largest["geom_pos"] * factor
        self.model.mesh_vert[:] = self._largest["mesh_vert"] * factor
        self.model.body_quat[self._body] = placement.orientation
        self.model.body_pos[self._body, 1:] = placement.offset
        self.data.qpos[0] = self.data.ctrl[0] = position

    def step(self, position: float) -> float:
        """Command the guide to ``position`` [m], advance one timestep, and return the pad's push [N]."""
        self._control[0] = position
        mujoco.mj_step(self.model, self.data)
        return self.force

    @property
    def force(self) -> float:
        """Normal force between pad and object [N]: contact is all that constrains the guide."""
        return float(self._reaction[0])

    @property
    def num_warnings(self) -> int:
        """MuJoCo warnings since the object was placed."""
        return int(self.data.warning.number.sum())
