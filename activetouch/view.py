"""Pictures of a press in its scene, and of bodies as believed: without OpenGL, and the same on every machine.

The picture of a body that is not known for certain is the mean over its orientations and sizes, which is sharper after
each touch. Orientations that look alike by symmetry give the same picture, so symmetric shapes become as sharp as
others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.poses import Placement, WorldObject, multiply, to_matrices, to_matrix, turn, turned
from activetouch.pressing.contact import Pad, Trace, first_touch
from activetouch.pressing.rig import Rig
from activetouch.solids.raster import heights
from activetouch.solids.solid import Shape
from belief.observation_model.rigid_body import joint_model
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence
from belief.validation import Floats

if TYPE_CHECKING:
    from activetouch.pose_belief import PoseBelief
    from activetouch.pressing.surroundings import Surroundings
    from activetouch.sensor.tactile import TactileSensor
    from belief.observation_model.nested_bodies import NestedEvidence

BodyEvidence: TypeAlias = "RigidBodyEvidence | NestedEvidence"
_SKY = (237, 240, 245)
_LIGHT = np.array([0.45, -0.55, 0.7])  # direction towards the light
_AZIMUTH, _ELEVATION = np.deg2rad([128.0, -27.0])  # direction of the camera: from the front right and above
_FIELD_OF_VIEW = np.deg2rad(35.0)  # vertical
_SEEN = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # groups of geoms; the other groups hold geoms that only collide
_WHOLE = 1.6  # distance at which a camera sees a whole model, relative to its extent
_MOST_FRAMES, _FRAME = 40, (320, 240)  # number and size [pixels] of the frames of an animation
_ABOVE = multiply(turn("y", np.deg2rad(-25.0)), turn("z", np.deg2rad(35.0)))  # the view of a portrait
_LAMP = np.array([0.75, -0.35, 0.55])
_SURFACE = np.array([(11, 29, 51), (63, 111, 159), (219, 231, 242)]) / 255  # colours of a body, from dark to light


def press_picture(
    pad: Pad, placement: Placement, depth: float, around: Surroundings | None = None, **view: Any
) -> NDArray[np.uint8]:
    """A picture of the object pressed ``depth`` [m] into the pad; ``view`` is size and sky of :func:`cast_rays`."""
    _, touching = first_touch(pad, placement)
    position = touching - depth if np.isfinite(touching) else placement.bounding_radius
    rig = Rig(pad, placement.shape.geom, timestep=0.002, largest_scale=placement.scale, around=around)
    rig.place(position, placement)
    mujoco.mj_forward(rig.model, rig.data)
    seen = np.array([position / 2, 0.0, 0.0]), 5.5 * max(pad.half_width, placement.bounding_radius)
    if around is not None:
        seen = rig.model.stat.center, _WHOLE * rig.model.stat.extent
    return cast_rays(rig.model, rig.data, *seen, **view)


def press_motion(path: Path, pad: Pad, placement: Placement, trace: Trace, around: Surroundings | None) -> None:
    """Write the motion of a press as an animated picture; before it, a robot brings its hand."""
    timestep, along = float(trace.time[-1] - trace.time[-2]), trace.position[:, 0].tolist()
    rig = Rig(pad, placement.shape.geom, timestep, largest_scale=placement.scale, around=around)
    rig.place(along[0], placement)
    states, seen = [], (np.array([0.01, 0.0, 0.0]), 5.5 * max(pad.half_width, 0.02))
    if around is not None:
        states, seen = around.arrival(rig), (rig.model.stat.center, _WHOLE * rig.model.stat.extent)
    states += [np.array([position, *rig.data.qpos[1:]]) for position in along]
    write_motion(path, rig.model, states, *seen)


def write_motion(
    path: Path,
    model: mujoco.MjModel,
    states: Sequence[NDArray[np.float64]],
    middle: NDArray[np.float64],
    distance: float,
) -> None:
    """Write a motion as an animated picture, at half its speed, with the last state for a second.

    ``states`` are joint positions, at least one, one for each time step; ``middle (3,)`` of the picture and
    ``distance`` of the camera from it are in [m].
    """
    from PIL import Image

    data, every, frames = mujoco.MjData(model), -(-len(states) // _MOST_FRAMES), []
    for state in [*states[::every], states[-1]]:
        data.qpos[:] = state
        mujoco.mj_forward(model, data)
        frames.append(Image.fromarray(cast_rays(model, data, middle, distance, _FRAME, oversampling=1)))
    durations = [round(2000 * every * model.opt.timestep)] * (len(frames) - 1) + [1000]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=80)


def cast_rays(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    middle: NDArray[np.float64],
    distance: float,
    size: tuple[int, int] = (640, 480),
    sky: tuple[int, int, int] = _SKY,
    oversampling: int = 2,
) -> NDArray[np.uint8]:
    """A picture by a camera, ``(height, width, 3)``, with Lambert shading, without geoms of the groups 3 to 5.

    ``middle (3,)`` of the picture and ``distance`` of the camera from it are in [m]; ``size`` is width and height
    [pixels], ``sky`` the colour of the background, in [0, 255].
    """
    width, height = size
    level = np.cos(_ELEVATION)
    forward = np.array([level * np.cos(_AZIMUTH), level * np.sin(_AZIMUTH), np.sin(_ELEVATION)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rows, columns = height * oversampling, width * oversampling
    span = np.tan(_FIELD_OF_VIEW / 2)
    y = (1 - (2 * np.arange(rows) + 1) / rows) * span
    x = ((2 * np.arange(columns) + 1) / columns - 1) * span * columns / rows
    rays = forward + x[None, :, None] * right + y[:, None, None] * np.cross(right, forward)
    rays = (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)
    geoms, gaps, normals = np.full(len(rays), -1, np.int32), np.zeros(len(rays)), np.zeros((len(rays), 3))
    camera, farthest = middle - distance * forward, mujoco.mjMAXVAL
    mujoco.mj_multiRay(
        model, data, camera, rays.ravel(), _SEEN, True, -1, geoms, gaps, normals.ravel(), len(rays), farthest
    )
    shade = 0.35 + 0.65 * np.clip(normals @ _LIGHT / np.linalg.norm(_LIGHT), 0.0, 1.0)
    paint, material = model.geom_rgba[:, :3].copy(), model.geom_matid
    paint[material >= 0] = model.mat_rgba[material[material >= 0], :3]
    colours = np.where((geoms >= 0)[:, None], paint[geoms] * shade[:, None], np.array(sky) / 255)
    image = colours.reshape(height, oversampling, width, oversampling, 3).mean(axis=(1, 3))
    return np.rint(255 * np.clip(image, 0.0, 1.0)).astype(np.uint8)


def portraits(
    solid: Shape, orientations: Floats, reach: float, pixels: int = 96, sizes: Floats | float = 1.0
) -> Floats:
    """Pictures of a body, ``(n, pixels, pixels)`` in [0, 1], row 0 at the bottom; NaN beside the body.

    ``orientations (n, 4)`` are unit quaternions ``wxyz``, ``reach`` is half of a picture's width [m], and ``sizes`` are
    factors, ``(n,)`` or one number.
    """
    pixel = 2.1 * reach / pixels
    factors = np.broadcast_to(sizes, len(orientations))[:, None, None]
    turns = to_matrices(turned(_ABOVE, orientations)) * factors
    seen = heights(solid.surface, turns, np.zeros((len(turns), 2)), pixel, pixels)
    hit = np.isfinite(seen)
    filled = np.where(hit, seen, -reach)
    upwards, across = np.gradient(filled, pixel, axis=(1, 2))
    normals = np.stack([np.ones_like(filled), -across, -upwards], axis=-1)
    lit = normals @ (_LAMP / np.linalg.norm(_LAMP))
    light = np.clip(lit / np.linalg.norm(normals, axis=-1), 0.0, 1.0)
    return np.where(hit, 0.2 + 0.8 * light, np.nan)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Hypotheses of the objects' orientations and sizes, and the shapes (nominal solids) that they may have.

    ``rests (N, 4)`` are orientations at rest, unit quaternions ``wxyz``, of each level of cells, or of one table of
    hypotheses; ``sizes (N,)`` are factors. A picture, of ``pixels`` in width and height, is the mean of ``draws``
    bodies.
    """

    shapes: Mapping[str, Shape]
    rests: Sequence[Floats]
    sizes: Floats
    pixels: int = 96
    draws: int = 64

    @classmethod
    def of(cls, sensor: TactileSensor, pixels: int = 96, draws: int = 64) -> Bodies | None:
        """Bodies of a sensor's joint belief; None for a sensor with any other observation model."""
        if (model := joint_model(sensor.model)) is not None:
            rests, sizes, _ = sensor.scene.hypotheses(model.num_hypotheses)
            return cls(sensor.scene.solids, [rests], sizes, pixels, draws)
        if (levels := getattr(getattr(sensor.model, "bodies", None), "levels", None)) is not None:
            from activetouch.rotation_cells import centres

            return cls(sensor.scene.solids, list(map(centres, levels)), np.ones(1), pixels, draws)
        return None

    def likeliest(self, evidence: BodyEvidence, probs: Floats, number: int) -> list[tuple[str, float, Floats]]:
        """Label, probability and mean picture of likely shapes, ``(H, W, 2)``: shade times coverage, and coverage."""
        labels = list(self.shapes)
        found = []
        for shape in np.argsort(-probs, kind="stable")[:number].tolist():
            picture = self._mean(labels[shape], *self._hypotheses(evidence, shape))
            found.append((labels[shape], float(probs[shape]), picture))
        return found

    def lying(self, belief: PoseBelief) -> Floats:
        """Mean picture of a body that lies as is believed, ``(H, W, 2)``: shade times coverage, and coverage."""
        with np.errstate(divide="ignore"):
            return self._mean(belief.shape, belief.orientations, belief.sizes, np.log(belief.probs))

    def _mean(self, label: str, rests: Floats, sizes: Floats, log_weights: Floats) -> Floats:
        rows, counts = _draws(log_weights, self.draws)
        each = portraits(self.shapes[label], rests[rows], self._radius, self.pixels, sizes[rows])
        picture = np.stack([np.nan_to_num(each), np.isfinite(each)], axis=3)
        return np.average(picture, axis=0, weights=counts)

    def _hypotheses(self, evidence: BodyEvidence, shape: int) -> tuple[Floats, Floats, Floats]:
        """Orientations, sizes and log weights of the hypotheses of a shape."""
        if isinstance(evidence, RigidBodyEvidence):
            return self.rests[0], self.sizes, evidence.log_weights[shape]
        level, _, cell, log_weights = evidence.belief.leaves_of(np.array([shape]))
        rests = np.array([self.rests[at][one] for at, one in zip(level.tolist(), cell.tolist(), strict=True)])
        return rests, np.ones(len(rests)), log_weights

    def best(self, evidence: BodyEvidence, label: str) -> tuple[Floats, float]:
        """The most probable orientation at rest of a shape, a unit quaternion ``wxyz``, and its size."""
        rests, sizes, log_weights = self._hypotheses(evidence, list(self.shapes).index(label))
        row = int(log_weights.argmax())
        return rests[row], float(sizes[row])

    def touched(self, label: str, orientation: Floats, size: float, in_pad: Floats) -> tuple[float, float, bool]:
        """Row and column in a picture of the point that a pad meets first, and whether it is on the side that is seen.

        ``orientation (4,)`` is that at rest, ``in_pad (4,)`` the one in front of the pad.
        """
        solid, pixel = self.shapes[label], 2.1 * self._radius / self.pixels
        turns = np.stack([to_matrix(in_pad), to_matrix(turned(_ABOVE, orientation[None])[0])])
        met, seen = heights(solid.surface, size * turns, np.zeros((2, 2)), pixel, self.pixels)
        row, column = np.unravel_index(met.argmax(), met.shape)
        middle = (self.pixels - 1) / 2
        point = np.array([-met[row, column], (column - middle) * pixel, (row - middle) * pixel])
        x, y, z = turns[1] @ turns[0].T @ point
        row, column = (float(np.clip(one / pixel + middle, 0, self.pixels - 1)) for one in (z, y))
        return row, column, bool(-x >= seen[round(row), round(column)] - 2 * pixel)

    def outline(self, label: str, body: WorldObject) -> Floats:
        """Whether the true body, whose shape has this label, covers each pixel, ``(H, W)``."""
        solid = self.shapes[label] if body.member is None else body.member
        picture = portraits(solid, body.orientation[None], self._radius, self.pixels, body.scale)[0]
        return np.isfinite(picture).astype(float)

    @property
    def _radius(self) -> float:
        """Half of a picture's width [m]."""
        return max(solid.bounding_radius for solid in self.shapes.values()) * float(self.sizes.max())


def _draws(log_weights: Floats, number: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of some hypotheses, and how many of so many even quantiles of the weights fall on each."""
    weights = np.exp(log_weights - log_weights.max())
    order = np.random.default_rng(0).permutation(len(weights))  # neighbours in the sequence have similar orientations
    above = weights[order].cumsum()
    drawn = np.searchsorted(above, (np.arange(number) + 0.5) / number * above[-1])
    rows, counts = np.unique(order[np.minimum(drawn, len(order) - 1)], return_counts=True)
    return rows, counts


def coloured(picture: NDArray[np.float64], prob: float) -> NDArray[np.float64]:
    """Colours and opacity of a picture of :class:`Bodies`, ``(H, W, 4)``, fainter if the shape is less probable."""
    shade, coverage = np.moveaxis(picture, 2, 0)
    light = np.divide(shade, coverage, out=np.zeros_like(shade), where=coverage > 0.0)
    colours = [np.interp(light, (0.0, 0.5, 1.0), channel) for channel in np.transpose(_SURFACE)]
    return np.stack([*colours, coverage * (0.25 + 0.75 * prob)], axis=2)
