"""The MuJoCo model of a press on a soft body: the pad as a flex of tetrahedra, one object on a linear guide.

The pad is a regular grid of nodes with a clamped back face. The guide is damped and pulled by a constant force, so its
velocity is proportional to the force error, as in admittance control. MuJoCo's ``discrete`` integrator solves guide,
contacts and elasticity together, so the motion is stable for any contact stiffness.
"""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.pressing.pad import Pad, SoftPad
from activetouch.pressing.rig import LARGEST_SCALE, add_solid
from activetouch.shapes import Geom, Shape

Floats = NDArray[np.float64]

_PAD_MASS = 0.3  # [kg]; heavier than gel, for a well-conditioned implicit step; only the equilibrium matters
_OBJECT_MASS = 0.05  # [kg]; light, so that the guide is overdamped
_NEO_HOOKEAN = 1  # of mjsFlex.elastic3d
_SOLVER_ITERATIONS = 400  # the unloaded pad alone takes 50-200 of the preconditioned solver; the default is 100

# CG is four times as fast as Newton here. The contact is stiffer than MuJoCo's default, so that the layer determines
# the depth.
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


def build_soft_spec(pad: Pad, soft: SoftPad, geom: Geom) -> mujoco.MjSpec:
    """The model of a soft pad of the size of ``pad`` and one object at its largest size, not compiled."""
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
    # Neo-Hookean: MuJoCo's default Saint Venant-Kirchhoff solid softens under compression and folds under a cone's tip.
    spec.flexes[0].elastic3d = _NEO_HOOKEAN
    guide = spec.worldbody.add_body(name="guide")
    guide.add_joint(
        name="guide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0], damping=[1 / soft.admittance, 0.0, 0.0]
    )
    body = guide.add_body(name="object")  # its own body, so that its orientation does not turn the guide
    add_solid(spec, body, "object", geom, LARGEST_SCALE, mass=_OBJECT_MASS)
    return spec


class SoftRig:
    """A compiled model of a soft pad and one object, which can be placed and pressed many times."""

    def __init__(self, pad: Pad, soft: SoftPad, geom: Geom) -> None:
        self.model = build_soft_spec(pad, soft, geom).compile()
        self.data = mujoco.MjData(self.model)
        self._body, self._geom = self.model.body("object").id, self.model.geom("object").id
        joint = self.model.joint("guide")
        self._qpos, self._dof = joint.qposadr[0], joint.dofadr[0]
        mujoco.mj_forward(self.model, self.data)
        self._rest = self.data.flexvert_xpos.copy()
        self._grid = (soft.layers + 1, soft.nodes, soft.nodes)  # of the nodes: x, y, z
        # Clamped nodes belong to the world's body and have no degrees of freedom.
        self._free = self.model.flex_vertbodyid > 0
        self._node_dofs = self.model.body_dofadr[self.model.flex_vertbodyid[self._free]]  # of x; y and z follow
        self._compiled = {
            name: getattr(self.model, name).copy() for name in ("geom_size", "geom_pos", "mesh_vert", "body_ipos")
        }

    def place(self, position: float, placement: Placement, target_force: float) -> None:
        """Put the object at rest with its centre ``position`` [m] before the pad, pulled by ``target_force`` [N]."""
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
        """Simulate one timestep and return the normal force [N], the constraint force on the guide."""
        mujoco.mj_step(self.model, self.data)
        return float(self.data.qfrc_constraint[self._dof])

    @property
    def indentation(self) -> Floats:
        """Indentation of the nodes of the face, ``(nodes, nodes)``, rows along z [m]; < 0 where the face bulges."""
        pushed_in = (self._rest - self.data.flexvert_xpos)[:, 0]
        return pushed_in.reshape(self._grid)[-1].T

    @property
    def node_forces(self) -> Floats:
        """Normal contact force on each column of nodes, ``(nodes, nodes)``, rows along z [N]."""
        forces = np.zeros(self._free.size)
        forces[self._free] = -self.data.qfrc_constraint[self._node_dofs]
        return forces.reshape(self._grid).sum(axis=0).T

    @property
    def num_warnings(self) -> int:
        """MuJoCo warnings since the object was placed."""
        return int(self.data.warning.number.sum())


@lru_cache(maxsize=32)
def shared_soft_rig(pad: Pad, soft: SoftPad, shape: Shape) -> SoftRig:
    """The cached rig of this process."""
    return SoftRig(pad, soft, shape.geom)
