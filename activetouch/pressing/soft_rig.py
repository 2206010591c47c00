"""The MuJoCo model of a press on a soft body: the pad as a flex of tetrahedra, one object on a linear guide.

The pad is a regular grid of nodes whose back face is clamped; each other node has three degrees of freedom. A damped
guide pulled by a constant force is admittance control without a controller: its velocity is proportional to the missing
force, and MuJoCo's ``discrete`` integrator solves guide, contacts and elasticity of a step together, so that the loop
is stable whatever the stiffness of the contact (decision 0003 has the force law this one is compared with).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.pressing.pad import Pad
from activetouch.pressing.rig import LARGEST_SCALE, add_solid
from activetouch.shapes import Shape

Floats = NDArray[np.float64]

_PAD_MASS = 0.3  # [kg]; more than gel weighs: only rest is read, and a heavier pad conditions the implicit step
_OBJECT_MASS = 0.05  # [kg]; little, so that the guide is overdamped even against a whole face
_NEO_HOOKEAN = 1  # of mjsFlex.elastic3d
_SOLVER_ITERATIONS = 400  # the unloaded pad alone takes 50-200 of the preconditioned solver; the default is 100

# CG and not Newton: a fine 3D mesh fills in the factorised Hessian, and CG is four times as fast here. The contact is
# stiffer than MuJoCo's default, so that the depth is the layer's and not the contact's.
_PAD = """
<mujoco>
  <option timestep="{timestep}" gravity="0 0 0" integrator="discrete" solver="CG" cone="elliptic"
          tolerance="1e-6" iterations="{iterations}"/>
  <worldbody>
    <flexcomp name="pad" type="grid" dim="3" count="{planes} {nodes} {nodes}" mass="{mass}" radius="0"
              spacing="{layer} {spacing} {spacing}" pos="{centre} 0 0">
      <contact selfcollide="none" condim="3" priority="1" solref="{contact_time} 1" solimp="0.99 0.999 0.0001"/>
      <elasticity young="{young}" poisson="{poisson}" damping="{damping}"/>
      <pin gridrange="0 0 0 0 {last} {last}"/>
    </flexcomp>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True)
class SoftPad:
    """A block of elastic solid and its simulation; see :class:`activetouch.pressing.deformable.Deformable`.

    Attributes:
        pad: gives the block's size.
        nodes, layers, young, poisson, damping, timestep, admittance: of the press.
    """

    pad: Pad
    nodes: int
    layers: int
    young: float
    poisson: float
    damping: float
    timestep: float
    admittance: float


def build_soft_spec(soft: SoftPad, shape: Shape) -> mujoco.MjSpec:
    """The model of a soft pad and one object at its largest size, ready to compile."""
    pad = soft.pad
    thickness = 2 * pad.half_thickness
    spec = mujoco.MjSpec.from_string(
        _PAD.format(
            timestep=soft.timestep,
            iterations=_SOLVER_ITERATIONS,
            planes=soft.layers + 1,
            nodes=soft.nodes,
            last=soft.nodes - 1,
            mass=_PAD_MASS,
            layer=thickness / soft.layers,
            spacing=2 * pad.half_width / (soft.nodes - 1),
            centre=-pad.half_thickness,
            contact_time=2 * soft.timestep,
            young=soft.young,
            poisson=soft.poisson,
            damping=soft.damping,
        )
    )
    # Neo-Hookean (experimental in MuJoCo 4.0): the default Saint Venant-Kirchhoff solid gets softer the more it is
    # compressed, folds under a cone's tip and never comes to rest there.
    spec.flexes[0].elastic3d = _NEO_HOOKEAN
    guide = spec.worldbody.add_body(name="guide")
    guide.add_joint(
        name="guide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0], damping=[1 / soft.admittance, 0.0, 0.0]
    )
    body = guide.add_body(name="object")  # its own body, so that turning it leaves the guide's axis alone
    add_solid(spec, body, "object", shape, LARGEST_SCALE, mass=_OBJECT_MASS)
    return spec


class SoftRig:
    """A compiled soft pad and one object, placed and stepped press after press."""

    def __init__(self, soft: SoftPad, shape: Shape) -> None:
        self.model = build_soft_spec(soft, shape).compile()
        self.data = mujoco.MjData(self.model)
        self._body, self._geom = self.model.body("object").id, self.model.geom("object").id
        joint = self.model.joint("guide")
        self._qpos, self._dof = joint.qposadr[0], joint.dofadr[0]
        mujoco.mj_forward(self.model, self.data)
        self._rest = self.data.flexvert_xpos.copy()
        self._grid = (soft.layers + 1, soft.nodes, soft.nodes)  # of the nodes: x, y, z
        # Clamped nodes are vertices of the world's body: they have no degrees of freedom and no share in the force.
        self._free = self.model.flex_vertbodyid > 0
        self._node_dofs = self.model.body_dofadr[self.model.flex_vertbodyid[self._free]]  # of x; y and z follow
        self._compiled = {
            name: getattr(self.model, name).copy() for name in ("geom_size", "geom_pos", "mesh_vert", "body_ipos")
        }

    def place(self, position: float, placement: Placement, target_force: float) -> None:
        """Put the object at rest, its centre ``position`` [m] before the pad, pulled by ``target_force`` [N]."""
        factor = placement.scale / LARGEST_SCALE
        if not 0.0 < factor <= 1.0:
            raise ValueError(f"scale must be in (0, {LARGEST_SCALE}], got {placement.scale}")
        mujoco.mj_resetData(self.model, self.data)
        for name in ("geom_size", "geom_pos", "mesh_vert", "body_ipos"):
            getattr(self.model, name)[:] = self._compiled[name] * factor
        self.model.flex_friction[:, 0] = placement.friction
        self.model.body_quat[self._body] = placement.orientation
        self.model.body_pos[self._body, 1:] = placement.offset
        self.data.qpos[self._qpos] = position
        self.data.qfrc_applied[self._dof] = -target_force

    def step(self) -> float:
        """Advance one timestep and return the pad's push [N]: contact is all that constrains the guide."""
        mujoco.mj_step(self.model, self.data)
        return float(self.data.qfrc_constraint[self._dof])

    @property
    def indentation(self) -> Floats:
        """How far the nodes of the face are pushed in, ``(nodes, nodes)``, rows along z [m]; < 0 where it bulges."""
        pushed_in = (self._rest - self.data.flexvert_xpos)[:, 0]
        return pushed_in.reshape(self._grid)[-1].T

    @property
    def node_forces(self) -> Floats:
        """Normal contact force that each column of nodes carries, ``(nodes, nodes)``, rows along z [N]."""
        forces = np.zeros(self._free.size)
        forces[self._free] = -self.data.qfrc_constraint[self._node_dofs]
        return forces.reshape(self._grid).sum(axis=0).T

    @property
    def num_warnings(self) -> int:
        """MuJoCo warnings since the object was placed."""
        return int(self.data.warning.number.sum())


@lru_cache(maxsize=32)
def shared_soft_rig(soft: SoftPad, shape: Shape) -> SoftRig:
    """The process's compiled model of these settings."""
    return SoftRig(soft, shape)
