"""Pictures of a press in its scene, by ray casting: without OpenGL, and the same on every machine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.poses import Placement
from activetouch.pressing.contact import Pad, Trace, first_touch
from activetouch.pressing.rig import Rig

if TYPE_CHECKING:
    from activetouch.pressing.surroundings import Surroundings

_SKY = (237, 240, 245)
_LIGHT = np.array([0.45, -0.55, 0.7])  # direction towards the light
_AZIMUTH, _ELEVATION = np.deg2rad([128.0, -27.0])  # direction of the camera: from the front right and above
_FIELD_OF_VIEW = np.deg2rad(35.0)  # vertical
_SEEN = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # groups of geoms; the other groups hold geoms that only collide
_WHOLE = 1.6  # distance at which a camera sees a whole model, relative to its extent
_MOST_FRAMES, _FRAME = 40, (320, 240)  # number and size [pixels] of the frames of an animation


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
