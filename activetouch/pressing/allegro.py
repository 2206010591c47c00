"""The Allegro hand closes on a body: joint targets by inverse kinematics, and a pad on each of four fingertips.

The model of the hand is ``wonik_allegro/right_hand.xml`` of MuJoCo Menagerie, which is not part of this package. Its
palm is fixed; an arm would change no touch. The pads look 45° forward on the fingertips, so that the three fingers and
the thumb can oppose each other around a small body.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.poses import Placement, multiply, to_matrix, turn
from activetouch.pressing.closing import Closing, Gripper, add_body, add_finger_pad, in_front
from activetouch.pressing.contact import Pad
from activetouch.pressing.surroundings import ALLEGRO, menagerie_file
from activetouch.solids.solid import Floats
from belief.errors import InvalidArgument

ALLEGRO_PAD = Pad(half_width=0.010, half_thickness=0.003, num_taxels=32)
"""A pad as wide as a fingertip."""
ALLEGRO_LAW = Closing(speed=0.05, admittance=0.03)
"""How the hand closes: slower, as its joints give way."""
_MOUNTS = {  # of each pad in the frame of its fingertip: height [m], how far it looks forward and sideways [degrees]
    "ff": (0.029, 32.0, -69.0),
    "mf": (0.029, 32.0, 0.0),
    "rf": (0.029, 32.0, 69.0),
    "th": (0.043, 17.0, 0.0),
}
_RADIUS = 0.015  # distance of the pads' faces from the middle of a fingertip's end [m]
_MIDDLE = np.array([0.110, 0.033, 0.003])  # point between the fingertips, in the frame of the palm [m]
_POSTURE = np.array(  # joints of the fingers around a small body [rad]
    [0.16, 0.94, 0.73, 0.71, 0.29, 0.82, 1.02, -0.01, 0.40, 1.35, 0.30, 0.29, 1.37, 0.15, 0.37, 0.27]
)
_CLEARANCE = 0.008  # distance between a body and the pads before they close [m]
_STIFFNESS, _DAMPING, _TORQUE = 30.0, 0.3, 0.7  # numbers of the joints' servos [N m/rad], [N m s/rad], [N m]
_ARMATURE = 0.001  # inertia of their motors behind the gears [kg m²]
_DAMPED = 5e-3  # damping of the least squares [m]


class AllegroFingers(Gripper):
    """The Allegro hand around a body; ``folder`` is a copy of MuJoCo Menagerie, which has the model of the hand.

    The body's offset is from the middle of the fingertips along the palm's y and z, its ``depth`` along x [m].
    """

    in_unison = True
    camera = (0.075, 0.015, 0.0), 0.32

    def __init__(self, law: Closing, folder: Path, pad: Pad, placement: Placement, depth: float) -> None:
        file = menagerie_file(folder, ALLEGRO)
        spec = mujoco.MjSpec.from_file(str(file))
        if lacks := [name for name in _MOUNTS if spec.body(f"{name}_tip") is None]:
            raise InvalidArgument(f"{file} is no model of the right Allegro hand: it has no body {lacks[0]}_tip")
        spec.body("palm").quat = [1.0, 0.0, 0.0, 0.0]
        for number, (name, (height, forward, sideways)) in enumerate(_MOUNTS.items()):
            looks = multiply(turn("z", np.deg2rad(sideways)), turn("y", -np.deg2rad(forward)))
            mount = spec.body(f"{name}_tip").add_body(name=f"mount{number}", pos=[0.0, 0.0, height], quat=looks)
            add_finger_pad(spec, mount, number, pad, (_RADIUS, 0.0, 0.0), mass=0.005)
        for joint in spec.joints:
            joint.armature = _ARMATURE
        for servo in spec.actuators:
            servo.set_to_position(kp=_STIFFNESS, kv=_DAMPING)
            servo.forcerange = [-_TORQUE, _TORQUE]
        self._fingers, self._reached = spec.compile(), _POSTURE.copy()
        self._state = mujoco.MjData(self._fingers)
        self._mounts = [self._fingers.body(f"mount{number}").id for number in range(len(_MOUNTS))]
        centre = _MIDDLE + np.array([depth, *placement.offset])
        open_at = placement.bounding_radius + float(np.linalg.norm(centre - _MIDDLE)) + _CLEARANCE
        self._reach = np.full(len(_MOUNTS), open_at)
        for _ in range(100):
            self._solve()
        rotations = self._state.xmat[self._mounts].reshape(-1, 3, 3)
        turned = to_matrix(placement.orientation)
        faces = self._state.xpos[self._mounts] + _RADIUS * rotations[:, :, 0]
        body = add_body(spec, turned, centre, pad, in_front(faces, rotations, centre, turned, placement)[0])
        body.add_freejoint()
        super().__init__(spec, law, pad, placement.bounding_radius, open_at)
        self.data.qpos[: len(_POSTURE)] = self.data.ctrl[:] = self._reached
        mujoco.mj_forward(self.model, self.data)

    def advance(self, moves: Floats) -> None:
        """See :class:`Gripper`."""
        self._reach -= moves
        self._solve()
        self.data.ctrl[:] = self._reached

    def stop(self, fingers: NDArray[np.bool_]) -> None:
        """See :class:`Gripper`."""
        at_hand = np.einsum("mi,mi->m", self.rotations[:, :, 0], _MIDDLE - self.faces)
        self._reach[fingers] = at_hand[fingers]
        joints = np.repeat(fingers, 4)
        self._reached[joints] = self.data.qpos[: len(_POSTURE)][joints]

    def _solve(self) -> None:
        """One step of damped least squares: the point at its reach before each pad goes to the middle of the hand."""
        model, state = self._fingers, self._state
        state.qpos[:] = self._reached
        mujoco.mj_kinematics(model, state)
        mujoco.mj_comPos(model, state)
        towards, jacobian = 0.05 * (_POSTURE - self._reached), np.empty((3, model.nv))
        for number, mount in enumerate(self._mounts):
            point = state.xpos[mount] + (_RADIUS + self._reach[number]) * state.xmat[mount].reshape(3, 3)[:, 0]
            mujoco.mj_jac(model, state, jacobian, None, point, mount)
            joints = slice(4 * number, 4 * number + 4)
            rows = jacobian[:, joints]
            inverse = rows.T @ np.linalg.inv(rows @ rows.T + _DAMPED**2 * np.eye(3))
            towards[joints] += inverse @ (_MIDDLE - point - rows @ towards[joints])
        low, high = model.jnt_range.T
        self._reached = np.clip(self._reached + np.clip(towards, -0.1, 0.1), low, high)
