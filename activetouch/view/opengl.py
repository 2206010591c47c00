"""Draws one view of a model with MuJoCo's renderer: a program of its own, because OpenGL has to be tried.

Which backend works shows only when it is used, MuJoCo chooses it when it is imported, and a wrong one may take the
process with it. So :func:`draw_in_child` runs this module with one backend after the other.

    python -m activetouch.view.opengl folder        # reads view.json, model.mjb and qpos.npy there, writes image.npy
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

SKY = (237, 240, 245)
"""Colour of what is behind everything."""
_BACKENDS = ("egl", "osmesa", "glfw")


@dataclass(frozen=True)
class View:
    """What a picture shows.

    Attributes:
        lookat: point in the middle of it [m].
        distance: of the camera from that point [m].
        azimuth, elevation: direction in which the camera looks [degrees].
        field_of_view: vertical [degrees].
        width, height: of the picture [pixels].
    """

    lookat: tuple[float, float, float]
    distance: float
    azimuth: float
    elevation: float
    field_of_view: float
    width: int
    height: int


def draw_in_child(model: mujoco.MjModel, data: mujoco.MjData, view: View) -> NDArray[np.uint8] | None:
    """The view, ``(height, width, 3)``, by the first backend that works; None where none does.

    The backend that ``MUJOCO_GL`` names is tried first.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        mujoco.mj_saveModel(model, str(folder / "model.mjb"))
        np.save(folder / "qpos.npy", data.qpos)
        (folder / "view.json").write_text(json.dumps(asdict(view)))
        for backend in dict.fromkeys((os.environ.get("MUJOCO_GL", ""), *_BACKENDS)):
            command = [sys.executable, "-m", "activetouch.view.opengl", name]
            environment = {**os.environ, "MUJOCO_GL": backend}
            if backend and not subprocess.run(command, env=environment, capture_output=True, check=False).returncode:
                return np.load(folder / "image.npy")
    return None


def main(folder: Path) -> None:
    """Draw what the folder describes."""
    view = View(**json.loads((folder / "view.json").read_text()))
    model = mujoco.MjModel.from_binary_path(str(folder / "model.mjb"))
    data = mujoco.MjData(model)
    data.qpos[:] = np.load(folder / "qpos.npy")
    mujoco.mj_forward(model, data)
    model.vis.global_.fovy = view.field_of_view
    model.vis.global_.offwidth, model.vis.global_.offheight = view.width, view.height
    model.vis.quality.shadowsize, model.vis.quality.offsamples = 0, 4  # shadows cost most of the time in software
    model.vis.headlight.ambient, model.vis.headlight.diffuse = np.full(3, 0.5), np.full(3, 0.6)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = view.lookat, view.distance
    camera.azimuth, camera.elevation = view.azimuth, view.elevation
    with mujoco.Renderer(model, view.height, view.width) as renderer:
        renderer.update_scene(data, camera)
        image = renderer.render().copy()
        renderer.enable_depth_rendering()
        depth = renderer.render()
        image[depth > 0.99 * depth.max()] = SKY  # where there is nothing
        np.save(folder / "image.npy", image)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
