"""A press on a pad that deforms: the slow reference for the elastic foundation of the other presses.

The foundation of :class:`activetouch.pressing.pad.Pad` is a bed of independent springs. Here the pad is a block of
isotropic elastic solid, discretised by MuJoCo into tetrahedra (a *flex*), whose face dips around the object, bulges
beside it and carries more under an edge. Nothing here is shared with the foundation but the pad's size and where the
object stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import convolve1d

from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, first_touch
from activetouch.pressing.dynamic import require_force
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Press
from activetouch.pressing.setup import Setup
from activetouch.shapes import Shape

if TYPE_CHECKING:
    import mujoco

    from activetouch.pressing.soft_rig import SoftPad

Floats = NDArray[np.float64]

_CLEARANCE = 0.0005  # of the object at the start [m]; a corner between two taxels is a tenth of it nearer
_SMOOTHING = (0.25, 0.5, 0.25)  # of the forces of neighbouring nodes


@dataclass(frozen=True)
class Deformable(Press):
    """The object is pulled against an elastic block with the stop force until the pad carries it.

    Of the setup, only the pad is modelled. The indentation is that of the block's face and may exceed the pad's
    ``max_depth``: a block does not bottom out.

    Attributes:
        nodes: of the block along an edge of its face; the time of a press grows with their square. Odd
            numbers put a node on the approach axis, where edges and tips touch.
        layers: of tetrahedra through the thickness.
        young: Young's modulus [Pa]; the default gives the foundation's 1.5 mm under a 20 mm sphere at 2 N.
        poisson: Poisson's ratio, in [0, 0.5); close to 0.5 linear tetrahedra lock.
        damping: of the material, relative to its stiffness [s]; it settles the block and does not move its rest.
        timestep: of the simulation [s].
        admittance: velocity of the guide per newton of missing force [m/s/N].
        tolerance: how near the force must stay to the stop, relative.
        pause: for how long [s].
        patience: how long to wait for that before giving up [s].
    """

    moves: ClassVar[bool] = True
    is_slow: ClassVar[bool] = True
    deforms: ClassVar[bool] = True

    nodes: int = 25
    layers: int = 4
    young: float = 1.03e5
    poisson: float = 0.3
    damping: float = 0.005
    timestep: float = 0.002
    admittance: float = 0.05
    tolerance: float = 0.02
    pause: float = 0.04
    patience: float = 2.0

    def __post_init__(self) -> None:
        if self.nodes < 2 or self.layers < 2:
            raise ValueError(f"the block needs 2 nodes and 2 layers or more, got {self.nodes} and {self.layers}")
        if not (self.young > 0.0 and 0.0 <= self.poisson < 0.5):
            raise ValueError(f"young must be positive and poisson in [0, 0.5), got {self.young} Pa, {self.poisson}")
        if not self.pause >= self.timestep > 0.0:
            raise ValueError(f"pause must be at least one timestep, got {self.pause} s and {self.timestep} s")

    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        from activetouch.pressing.soft_rig import shared_soft_rig  # loads MuJoCo

        require_force(target_force)
        pad = setup.pad
        gap, touching = first_touch(pad, placement)
        if not np.isfinite(gap).any():
            blank = np.zeros_like(gap)
            return Contact(pad, gap, 0.0, blank, blank)
        # All elastic stresses are proportional to Young's modulus: a block s times as stiff is the block under F / s.
        stop = target_force / placement.stiffness
        rig = shared_soft_rig(self._soft_pad(pad), placement.shape)
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

    def compiled(self, setup: Setup, shape: Shape) -> mujoco.MjModel:
        """See :class:`Press`."""
        from activetouch.pressing.soft_rig import build_soft_spec  # loads MuJoCo

        return build_soft_spec(self._soft_pad(setup.pad), shape).compile()

    def _soft_pad(self, pad: Pad) -> SoftPad:
        from activetouch.pressing.soft_rig import SoftPad  # loads MuJoCo

        return SoftPad(
            pad, self.nodes, self.layers, self.young, self.poisson, self.damping, self.timestep, self.admittance
        )


def _on_taxels(pad: Pad, nodal: Floats) -> Floats:
    """Linear interpolation from the nodes of the face to the taxels, ``(num_taxels, num_taxels)``."""
    edge = np.linspace(-pad.half_width, pad.half_width, len(nodal))
    at_taxels = RegularGridInterpolator((edge, edge), nodal)(pad.taxel_centres[[2, 1]].T)
    return at_taxels.reshape(pad.num_taxels, pad.num_taxels)


def _pressure(pad: Pad, node_forces: Floats, force: float) -> Floats:
    """Pressure on every taxel [Pa], of integral ``force``, from the forces on the nodes of the face.

    Each node's force is spread over the part of the face nearer to it than to others, half of it along the rim.
    MuJoCo gives a tetrahedron under a flat face one contact, at an arbitrary place on it, so that neighbouring nodes
    share their force by chance; the smoothing undoes that.
    """
    for axis in (0, 1):
        node_forces = convolve1d(node_forces, _SMOOTHING, axis=axis, mode="reflect")  # keeps the sum
    share = np.ones(len(node_forces))
    share[[0, -1]] = 0.5
    pressure = _on_taxels(pad, np.maximum(node_forces, 0.0) / np.outer(share, share))
    return pressure * (force / (pressure.sum() * pad.taxel_area))
