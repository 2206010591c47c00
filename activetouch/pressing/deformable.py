"""A press on a deformable pad: the slow reference for the elastic foundation of the other presses.

The pad is a block of isotropic elastic solid, which MuJoCo discretises into tetrahedra (a *flex*).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.pressing.contact import Contact, first_touch
from activetouch.pressing.dynamic import require_force
from activetouch.pressing.facing import facing_geom
from activetouch.pressing.pad import Pad, SoftPad
from activetouch.pressing.press import Press
from activetouch.pressing.setup import Setup
from activetouch.shapes import Shape

if TYPE_CHECKING:
    import mujoco

Floats = NDArray[np.float64]

_CLEARANCE = 0.0005  # distance between object and pad at the start [m]
_SMOOTHING = (0.25, 0.5, 0.25)  # of the pressures at neighbouring nodes


@dataclass(frozen=True)
class Deformable(SoftPad, Press):
    """A constant force pulls the object against an elastic block until the block carries it.

    Only the pad of the setup is modelled. The indentation may exceed the pad's ``max_depth``. See
    :class:`activetouch.pressing.pad.SoftPad` for the settings of the block.

    Attributes:
        tolerance: largest relative force error in the pause.
        pause: time during which the error must stay within the tolerance [s].
        patience: time after which the press fails [s].
    """

    moves: ClassVar[bool] = True
    is_slow: ClassVar[bool] = True
    deforms: ClassVar[bool] = True

    tolerance: float = 0.02
    pause: float = 0.04
    patience: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.pause >= self.timestep > 0.0:
            raise ValueError(f"pause must be at least one timestep, got {self.pause} s and {self.timestep} s")

    def press(self, setup: Setup, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        from activetouch.pressing.soft_rig import SoftRig, shared_soft_rig  # loads MuJoCo

        require_force(target_force)
        pad = setup.pad
        gap, touching = first_touch(pad, placement)
        if target_force == 0.0 or not np.isfinite(gap).any():
            blank = np.zeros_like(gap)
            return Contact(pad, gap, 0.0, blank, blank)
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

    def compiled(self, setup: Setup, shape: Shape) -> mujoco.MjModel:
        """See :class:`Press`."""
        from activetouch.pressing.soft_rig import build_soft_spec  # loads MuJoCo

        return build_soft_spec(setup.pad, self, shape.geom).compile()


def _on_taxels(pad: Pad, nodal: Floats) -> Floats:
    """Linear interpolation from the nodes of the face to the taxels, ``(num_taxels, num_taxels)``."""
    from scipy.interpolate import RegularGridInterpolator  # which takes a tenth of a second

    edge = np.linspace(-pad.half_width, pad.half_width, len(nodal))
    at_taxels = RegularGridInterpolator((edge, edge), nodal)(pad.taxel_centres[[2, 1]].T)
    return at_taxels.reshape(pad.num_taxels, pad.num_taxels)


def _pressure(pad: Pad, node_forces: Floats, force: float) -> Floats:
    """Pressure on every taxel [Pa], with integral ``force``, from the forces on the nodes of the face.

    MuJoCo makes one contact per tetrahedron, at an arbitrary point, which splits a force arbitrarily between
    neighbouring nodes. Smoothing removes this.
    """
    from scipy.ndimage import convolve1d

    share = np.ones(len(node_forces))
    share[[0, -1]] = 0.5  # nodes on the rim represent half the area
    pressures = node_forces / np.outer(share, share)
    for axis in (0, 1):
        pressures = convolve1d(pressures, _SMOOTHING, axis=axis, mode="mirror")  # keeps the force, and an even pressure
    pressure = _on_taxels(pad, np.maximum(pressures, 0.0))
    return pressure * (force / (pressure.sum() * pad.taxel_area))
