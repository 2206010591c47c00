"""Pictures of a press in its scene, by ray casting: without OpenGL, and the same on every machine."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.pressing.contact import first_touch
from activetouch.pressing.rig import Rig
from activetouch.pressing.setup import Setup

_SKY = (237, 240, 245)
_LIGHT = np.array([0.45, -0.55, 0.7])  # direction towards the light
_AZIMUTH, _ELEVATION = np.deg2rad([128.0, -27.0])  # of the camera: from the front right and above
_FIELD_OF_VIEW = np.deg2rad(35.0)  # vertical
_OVERSAMPLING = 2


def press_picture(
    setup: Setup,
    placement: Placement,
    depth: float,
    width: int = 640,
    height: int = 480,
    sky: tuple[int, int, int] = _SKY,
) -> NDArray[np.uint8]:
    """A picture ``(height, width, 3)`` of the object pressed ``depth`` [m] into the pad.

    Args:
        setup: the pad and its surroundings.
        placement: the object.
        depth: of the press [m].
        width: of the picture [pixels].
        height: of the picture [pixels].
        sky: colour of the background, in [0, 255].
    """
    _, touching = first_touch(setup.pad, placement)
    position = touching - depth if np.isfinite(touching) else placement.bounding_radius
    rig = Rig(setup, placement.shape, timestep=0.002, largest_scale=placement.scale)
    rig.place(position, placement)
    mujoco.mj_forward(rig.model, rig.data)
    middle = np.array([position / 2, 0.0, setup.height])
    distance = 5.5 * max(setup.pad.half_width, placement.bounding_radius)
    if setup.loaded:
        middle, distance = np.array([0.0, 0.1, setup.height]), 0.45
    return _cast_rays(rig.model, rig.data, middle, distance, (width, height), sky)


def _cast_rays(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    middle: NDArray[np.float64],
    distance: float,
    size: tuple[int, int],
    sky: tuple[int, int, int],
) -> NDArray[np.uint8]:
    """What a camera sees at a distance from the middle of the picture [m], with Lambert shading."""
    width, height = size
    level = np.cos(_ELEVATION)
    forward = np.array([level * np.cos(_AZIMUTH), level * np.sin(_AZIMUTH), np.sin(_ELEVATION)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rows, columns = height * _OVERSAMPLING, width * _OVERSAMPLING
    span = np.tan(_FIELD_OF_VIEW / 2)
    y = (1 - (2 * np.arange(rows) + 1) / rows) * span
    x = ((2 * np.arange(columns) + 1) / columns - 1) * span * columns / rows
    rays = forward + x[None, :, None] * right + y[:, None, None] * np.cross(right, forward)
    rays = (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)
    geoms, gaps, normals = np.full(len(rays), -1, np.int32), np.zeros(len(rays)), np.zeros((len(rays), 3))
    camera, farthest = middle - distance * forward, mujoco.mjMAXVAL
    mujoco.mj_multiRay(
        model, data, camera, rays.ravel(), None, True, -1, geoms, gaps, normals.ravel(), len(rays), farthest
    )
    shade = 0.35 + 0.65 * np.clip(normals @ _LIGHT / np.linalg.norm(_LIGHT), 0.0, 1.0)
    colours = np.where((geoms >= 0)[:, None], model.geom_rgba[geoms, :3] * shade[:, None], np.array(sky) / 255)
    image = colours.reshape(height, _OVERSAMPLING, width, _OVERSAMPLING, 3).mean(axis=(1, 3))
    return np.rint(255 * np.clip(image, 0.0, 1.0)).astype(np.uint8)
