"""Drawing of a model with MuJoCo's renderer in a child process.

MuJoCo chooses an OpenGL backend at import, and a wrong one may crash the process. So :func:`draw_in_child` runs this
file with one backend after the other, and leaves out those that failed before.

    python activetouch/view/opengl.py folder        # reads view.json, model.mjb and qpos.npy there, writes image.npy
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
"""Colour of the background."""
_BACKENDS = ("egl", "osmesa", "glfw")
_failed: set[str] = set()
"""Backends that could not draw in this process."""


@dataclass(frozen=True)
class CameraView:
    """Camera and size of a picture.

    Attributes:
        lookat: point in the middle of the picture [m].
        distance: of the camera from that point [m].
        azimuth, elevation: direction of view [degrees].
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


def draw_in_child(model: mujoco.MjModel, data: mujoco.MjData, view: CameraView) -> NDArray[np.uint8] | None:
    """The picture ``(height, width, 3)`` by the first backend that works, ``MUJOCO_GL`` first; None if none works."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        mujoco.mj_saveModel(model, str(folder / "model.mjb"))
        np.save(folder / "qpos.npy", data.qpos)
        (folder / "view.json").write_text(json.dumps(asdict(view)))
        for backend in dict.fromkeys((os.environ.get("MUJOCO_GL", ""), *_BACKENDS)):
            if not backend or backend in _failed:
                continue
            command = [sys.executable, "-P", __file__, name]  # as a file: the package takes a second to import
            environment = {**os.environ, "MUJOCO_GL": backend}
            if not subprocess.run(command, env=environment, capture_output=True, check=False).returncode:
                return np.load(folder / "image.npy")
            _failed.add(backend)
    return None


def main(folder: Path) -> None:
    """Draw the model in a folder, and write the image there."""
    view = CameraView(**json.loads((folder / "view.json").read_text()))
    model = mujoco.MjModel.from_binary_path(str(folder / "model.mjb"))
    data = mujoco.MjData(model)
    data.qpos[:] = np.load(folder / "qpos.npy")
    mujoco.mj_forward(model, data)
    model.vis.global_.fovy = view.field_of_view
    model.vis.global_.offwidth, model.vis.global_.offheight = view.width, view.height
    model.vis.quality.shadowsize, model.vis.quality.offsamples = 0, 4  # shadows are slow in software
    model.vis.headlight.ambient, model.vis.headlight.diffuse = np.full(3, 0.5), np.full(3, 0.6)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = view.lookat, view.distance
    camera.azimuth, camera.elevation = view.azimuth, view.elevation
    with mujoco.Renderer(model, view.height, view.width) as renderer:
        renderer.update_scene(data, camera)
        image = renderer.render().copy()
        renderer.enable_depth_rendering()
        depth = renderer.render()
        image[depth > 0.99 * depth.max()] = SKY
        np.save(folder / "image.npy", image)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
