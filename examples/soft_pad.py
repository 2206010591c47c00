"""A press of your own, on a pad that deforms: the slow reference for the elastic foundation of the product's presses.

Run in this folder; a press takes some seconds:

    activetouch touch --scene soft_pad:scene --shape cube --pose z45 --out edge.png

The pad is a block of isotropic elastic solid, which MuJoCo discretises into tetrahedra (a *flex*): a regular grid of
nodes with a clamped back face. The object moves on a damped guide, pulled by a constant force, so its velocity is
proportional to the force error, as in admittance control. MuJoCo's ``discrete`` integrator solves guide, contacts and
elasticity together, so the motion is stable for any contact stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import convolve1d

from activetouch import SCENES, Scene
from activetouch.errors import UnstablePress
from activetouch.poses import Placement
from activetouch.pressing.contact import Contact, Pad, Press, first_touch, missed
from activetouch.pressing.dynamic import facing_geom
from activetouch.pressing.rig import LARGEST_SCALE, add_solid
from activetouch.shapes import Geom, Shape

Floats = NDArray[np.float64]

_CLEARANCE = 0.0005  # distance between object and pad at the start [m]
_SMOOTHING = (0.25, 0.5, 0.25)  # of the pressures at neighbouring nodes
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


@dataclass(frozen=True)
class SoftPad:
    """A pad that is a block of elastic solid, discretised into tetrahedra, and the simulation of a press on it.

    Attributes:
        nodes: of the block along an edge of its face; the time of a press grows with their square. With an odd number,
            a node lies on the approach axis.
        layers: of tetrahedra through the thickness.
        young: Young's modulus [Pa]; the default gives the foundation's depth, 1.5 mm under a 20 mm sphere at 2 N.
        poisson: Poisson's ratio, in [0, 0.5); linear tetrahedra lock near 0.5.
        damping: of the material, relative to its stiffness [s]; it does not change the equilibrium.
        timestep: of the simulation [s].
        admittance: velocity of the guide per newton of force error [m/s/N].
    """

    nodes: int = 25
    layers: int = 4
    young: float = 1.03e5
    poisson: float = 0.3
    damping: float = 0.005
    timestep: float = 0.002
    admittance: float = 0.05

    def __post_init__(self) -> None:
        if self.nodes < 2 or self.layers < 2:
            raise ValueError(f"the block needs at least 2 nodes and 2 layers, got {self.nodes} and {self.layers}")
        if not (self.young > 0.0 and 0.0 <= self.poisson < 0.5):
            raise ValueError(f"young must be positive and poisson in [0, 0.5), got {self.young} Pa, {self.poisson}")


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


@dataclass(frozen=True)
class Deformable(SoftPad, Press):
    """A constant force pulls the object against an elastic block until the block carries it.

    The indentation may exceed the pad's ``max_depth``. See :class:`SoftPad` for
    the settings of the block.

    Attributes:
        tolerance: largest relative force error in the pause.
        pause: time during which the error must stay within the tolerance [s].
        patience: time after which the press fails [s].
    """

    moves: ClassVar[bool] = True

    tolerance: float = 0.02
    pause: float = 0.04
    patience: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.pause >= self.timestep > 0.0:
            raise ValueError(f"pause must be at least one timestep, got {self.pause} s and {self.timestep} s")

    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        gap, touching = first_touch(pad, placement)
        if target_force == 0.0 or not np.isfinite(gap).any():
            return missed(pad)
        # Stresses are proportional to Young's modulus: a block s times as stiff deforms as this one under F / s.
        stop = target_force / placement.stiffness
        facing = facing_geom(pad, placement, gap, touching)
        rig = shared_soft_rig(pad, self, placement.shape) if facing is None else SoftRig(pad, self, facing)
        rig.place(touching + _CLEARANCE, placement, stop)
        force, num_settled, num_steps = 0.0, 0, 0
        wanted, limit = round(self.pause / self.timestep), round(self.patience / self.timestep)
        while num_settled < wanted and num_steps < limit and not rig.num_warnings:
            force = rig.step()
            num_settled = num_settled + 1 if abs(force - stop) <= self.tolerance * stop else 0
            num_steps += 1
        force *= placement.stiffness
        if rig.num_warnings or num_settled < wanted:
            raise UnstablePress(
                f"pressing {placement} into a deformable pad: the force did not settle at {target_force:.3g} N (last "
                f"{force:.3g} N, step {num_steps}, {rig.num_warnings} MuJoCo warnings). Try a smaller timestep (now "
                f"{self.timestep} s), a larger young (now {self.young:.3g} Pa) or patience (now {self.patience} s)."
            )
        indentation = np.maximum(_on_taxels(pad, rig.indentation), 0.0)
        return Contact(pad, gap, force, indentation, _pressure(pad, rig.node_forces, force))

    def compiled(self, pad: Pad, shape: Shape) -> mujoco.MjModel:
        """See :class:`Press`."""
        return build_soft_spec(pad, self, shape.geom).compile()


def _on_taxels(pad: Pad, nodal: Floats) -> Floats:
    """Linear interpolation from the nodes of the face to the taxels, ``(num_taxels, num_taxels)``."""
    edge = np.linspace(-pad.half_width, pad.half_width, len(nodal))
    at_taxels = RegularGridInterpolator((edge, edge), nodal)(pad.taxel_centres[[2, 1]].T)
    return at_taxels.reshape(pad.num_taxels, pad.num_taxels)


def _pressure(pad: Pad, node_forces: Floats, force: float) -> Floats:
    """Pressure on every taxel [Pa], with integral ``force``, from the forces on the nodes of the face.

    MuJoCo makes one contact per tetrahedron, at an arbitrary point, which splits a force arbitrarily between
    neighbouring nodes. Smoothing removes this.
    """
    share = np.ones(len(node_forces))
    share[[0, -1]] = 0.5  # nodes on the rim represent half the area
    pressures = node_forces / np.outer(share, share)
    for axis in (0, 1):
        pressures = convolve1d(pressures, _SMOOTHING, axis=axis, mode="mirror")  # keeps the force, and an even pressure
    pressure = _on_taxels(pad, np.maximum(pressures, 0.0))
    return pressure * (force / (pressure.sum() * pad.taxel_area))


def scene(name: str = "gel", nodes: int = 25, layers: int = 4) -> Scene:
    """A scene by name, whose pad deforms."""
    return replace(SCENES[name].scene, press_model=Deformable(nodes=nodes, layers=layers))
