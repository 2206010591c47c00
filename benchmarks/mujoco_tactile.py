"""Compare our height maps with MuJoCo's own tactile sensor: the depth of each taxel inside the object.

MuJoCo's sensor measures for every vertex of a plate the distance to the nearest surface of the object around it, ours
the indentation along the pad's normal. Both agree on which taxels are inside, and on the depth where the surface is
parallel to the pad. The sensor needs a signed distance, which primitives have and meshes do not.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.poses import Placement
from activetouch.pressing.contact import Pad
from activetouch.shapes import Shape

Floats = NDArray[np.float64]

# The vertices of a plate are at the taxels' centres, in the order of our images. Its skin is on its lower side, facing
# −z, so the plate is rotated to face +x and moved back by its thickness.
_MODEL = """
<mujoco>
  <asset><mesh name="plate" builtin="plate" params="{n} {n}" scale="{plate}"/></asset>
  <worldbody>
    <body name="pad">
      <geom name="pad" type="box" size="{half_thickness} {half_width} {half_width}" pos="-{half_thickness} 0 0"/>
      <geom name="plate" type="mesh" mesh="plate" contype="0" conaffinity="0" pos="-{half_thickness} 0 0"
            quat="1 0 -1 0" mass="0"/>
    </body>
    <body>
      <joint name="guide" type="slide" axis="1 0 0"/>
      <body name="object">
        <geom name="object" type="{type}" size="{size}" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <sensor><tactile name="touch" geom="plate" mesh="plate"/></sensor>
</mujoco>
"""


class NativeSensor:
    """A plate of ``num_taxels`` × ``num_taxels`` vertices on the pad's face, under a primitive (no mesh)."""

    def __init__(self, pad: Pad, shape: Shape) -> None:
        geom = shape.geom
        if geom.vertices is not None:
            raise ValueError(f"the native sensor is used on primitives only, got {shape}")
        text = _MODEL.format(
            n=pad.num_taxels,
            plate=f"{pad.half_width} {pad.half_width} {pad.half_thickness}",
            half_width=pad.half_width,
            half_thickness=pad.half_thickness,
            type=geom.type,
            size=" ".join(map(str, geom.size)),
        )
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self._geom, self._body = self.model.geom("object").id, self.model.body("object").id
        self._size = self.model.geom_size[self._geom].copy()
        mujoco.mj_forward(self.model, self.data)
        plate = self.model.geom("plate").id
        vertices = self.model.mesh_vert @ self.data.geom_xmat[plate].reshape(3, 3).T + self.data.geom_xpos[plate]
        self.taxels = vertices[:, 1:].astype(float)
        """Positions of the vertices along y and z [m], ``(n², 2)``."""

    def depth(self, placement: Placement, position: float) -> Floats:
        """Depth of every vertex in the object, ``(n²,)`` [m]; ``position`` is from the face to its centre [m]."""
        self.model.geom_size[self._geom] = self._size * placement.scale
        self.model.body_quat[self._body] = placement.orientation
        self.model.body_pos[self._body, 1:] = placement.offset
        self.data.qpos[0] = position
        mujoco.mj_forward(self.model, self.data)
        return self.data.sensordata[: len(self.taxels)].copy()
