"""Pictures of a press in its scene, by MuJoCo's renderer if OpenGL works, else by ray casting."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.pressing.contact import first_touch
from activetouch.pressing.rig import Rig
from activetouch.pressing.setup import Setup
from activetouch.view.opengl import SKY, CameraView, draw_in_child

GL_HINT = (
    "no OpenGL backend works here, so the scene is drawn by ray casting. For MuJoCo's own renderer install "
    "activetouch[viewer] and, on Debian or Ubuntu, the package libegl1 (with a GPU) or libosmesa6 (without)."
)
_LIGHT = np.array([0.45, -0.55, 0.7])  # direction towards the light
_AZIMUTH, _ELEVATION, _FIELD_OF_VIEW = 128.0, -27.0, 35.0  # of the camera [degrees]: from the front right and above
_OVERSAMPLING = 2


def press_picture(
    setup: Setup, placement: Placement, depth: float, width: int = 640, height: int = 480, opengl: bool = True
) -> tuple[NDArray[np.uint8], bool]:
    """A picture ``(height, width, 3)`` of the object pressed ``depth`` [m] into the pad, and whether OpenGL drew it.

    Args:
        setup: the pad and its surroundings.
        placement: the object.
        depth: of the press [m].
        width: of the picture [pixels].
        height: of the picture [pixels].
        opengl: whether to try OpenGL, which takes a second or two per picture.
    """
    _, touching = first_touch(setup.pad, placement)
    position = touching - depth if np.isfinite(touching) else placement.bounding_radius
    rig = Rig(setup, placement.shape, timestep=0.002, largest_scale=placement.scale)
    rig.place(position, placement)
    mujoco.mj_forward(rig.model, rig.data)
    lookat = np.array([0.0, 0.0, setup.height])
    reach = 4.5 * max(setup.pad.half_width, placement.bounding_radius)
    if setup.loaded:
        lookat, reach = np.array([0.0, 0.1, setup.height]), 0.45
    view = CameraView(tuple(lookat.tolist()), reach, _AZIMUTH, _ELEVATION, _FIELD_OF_VIEW, width, height)
    drawn = draw_in_child(rig.model, rig.data, view) if opengl else None
    return (cast_rays(rig.model, rig.data, view), False) if drawn is None else (drawn, True)


def cast_rays(model: mujoco.MjModel, data: mujoco.MjData, view: CameraView) -> NDArray[np.uint8]:
    """A picture ``(height, width, 3)`` by ray casting, with Lambert shading in the geoms' colours."""
    azimuth, elevation = np.deg2rad([view.azimuth, view.elevation])
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    camera = np.array(view.lookat) - view.distance * forward
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    rows, columns = view.height * _OVERSAMPLING, view.width * _OVERSAMPLING
    span = np.tan(np.deg2rad(view.field_of_view) / 2)
    y = (1 - (2 * np.arange(rows) + 1) / rows) * span
    x = ((2 * np.arange(columns) + 1) / columns - 1) * span * columns / rows
    rays = forward + x[None, :, None] * right + y[:, None, None] * up
    rays = (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)
    geoms, distance, normals = np.full(len(rays), -1, np.int32), np.zeros(len(rays)), np.zeros((len(rays), 3))
    mujoco.mj_multiRay(
        model, data, camera, rays.ravel(), None, True, -1, geoms, distance, normals.ravel(), len(rays), mujoco.mjMAXVAL
    )
    light = _LIGHT / np.linalg.norm(_LIGHT)
    shade = 0.35 + 0.65 * np.clip(normals @ light, 0.0, 1.0)
    colours = np.where((geoms >= 0)[:, None], model.geom_rgba[geoms, :3] * shade[:, None], np.array(SKY) / 255)
    image = colours.reshape(view.height, _OVERSAMPLING, view.width, _OVERSAMPLING, 3).mean(axis=(1, 3))
    return np.rint(255 * np.clip(image, 0.0, 1.0)).astype(np.uint8)
