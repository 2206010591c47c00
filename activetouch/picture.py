"""A picture of a press in its scene: through MuJoCo's renderer where OpenGL is there, by ray casting where it is not.

Which backend works can only be found by trying, and a wrong one fails at import; so each is tried once, in a child
process. Without any, rays and a little shading draw the same view, without shadows, in about a tenth of a second.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from activetouch.contact import first_touch
from activetouch.placement import Placement
from activetouch.rig import Rig
from activetouch.stage import Stage

Image = NDArray[np.uint8]

GL_HINT = (
    "no OpenGL backend works here, so the scene is drawn by ray casting. For MuJoCo's own renderer install "
    "activetouch[viewer] and, on Debian or Ubuntu, the package libegl1 (with a GPU) or libosmesa6 (without)."
)
_BACKENDS = ("egl", "osmesa", "glfw")
_LIGHT = np.array([0.45, -0.55, 0.7])  # direction towards the light; need not be a unit vector
_SKY, _FIELD_OF_VIEW = np.array([0.93, 0.94, 0.96]), np.deg2rad(35.0)
_OVERSAMPLING = 2


@lru_cache(maxsize=1)
def gl_backend() -> str | None:
    """The value of ``MUJOCO_GL`` with which MuJoCo can draw here; the one that is set is tried first. None if none."""
    wanted = os.environ.get("MUJOCO_GL", "")
    for backend in dict.fromkeys((wanted, *_BACKENDS)):
        attempt = "import mujoco; context = mujoco.GLContext(8, 8); context.make_current(); context.free()"
        environment = {**os.environ, "MUJOCO_GL": backend}
        if (
            backend
            and not subprocess.run(
                [sys.executable, "-c", attempt], env=environment, capture_output=True, timeout=60, check=False
            ).returncode
        ):
            return backend
    return None


def press_picture(stage: Stage, placement: Placement, depth: float, width: int = 640, height: int = 480) -> Image:
    """The stage with the object pressed ``depth`` [m] into the pad, ``(height, width, 3)``."""
    _, touching = first_touch(stage.pad, placement)
    position = touching - depth if np.isfinite(touching) else placement.bounding_radius
    rig = Rig(stage, placement.shape, timestep=0.002)
    rig.place(position, placement)
    mujoco.mj_forward(rig.model, rig.data)
    lookat = np.array([0.0, 0.0, stage.height])
    reach = 4.5 * max(stage.pad.half_width, placement.bounding_radius)
    if stage.robot is not None or stage.loaded:  # show them too
        lookat, reach = np.array([0.0, 0.1, stage.height]), 0.45
    if stage.robot is not None:
        reach = 1.1
    return draw(rig.model, rig.data, lookat, reach, width, height)


def draw(
    model: mujoco.MjModel, data: mujoco.MjData, lookat: NDArray[np.float64], distance: float, width: int, height: int
) -> Image:
    """A view of a forwarded model from the front right and above, by the best means at hand.

    The point ``lookat`` [m] is in its middle, the camera ``distance`` [m] away from it.
    """
    backend = gl_backend()
    direction = np.array([0.55, -0.7, 0.45])
    direction /= np.linalg.norm(direction)
    if backend is None:
        return cast_rays(model, data, lookat + distance * direction, lookat, width, height)
    os.environ["MUJOCO_GL"] = backend
    model.vis.global_.fovy, model.vis.global_.offwidth, model.vis.global_.offheight = (
        np.rad2deg(_FIELD_OF_VIEW),
        width,
        height,
    )
    model.vis.quality.shadowsize, model.vis.quality.offsamples = 0, 4  # shadows cost most of the time in software
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = lookat, distance
    camera.azimuth, camera.elevation = (
        np.rad2deg(np.arctan2(-direction[1], -direction[0])),
        -np.rad2deg(np.arcsin(direction[2])),
    )
    with mujoco.Renderer(model, height, width) as renderer:
        renderer.update_scene(data, camera)
        return renderer.render().copy()


def cast_rays(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: NDArray[np.float64],
    lookat: NDArray[np.float64],
    width: int,
    height: int,
) -> Image:
    """The same view without OpenGL: one ray a sample, Lambert shading in the geoms' colours, ``(height, width, 3)``."""
    forward = (lookat - camera) / np.linalg.norm(lookat - camera)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    rows, columns = height * _OVERSAMPLING, width * _OVERSAMPLING
    span = np.tan(_FIELD_OF_VIEW / 2)
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
    colours = np.where((geoms >= 0)[:, None], model.geom_rgba[geoms, :3] * shade[:, None], _SKY)
    image = colours.reshape(height, _OVERSAMPLING, width, _OVERSAMPLING, 3).mean(axis=(1, 3))
    return np.rint(255 * np.clip(image, 0.0, 1.0)).astype(np.uint8)
