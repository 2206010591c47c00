"""The simulated world: shapes pressed against a tactile pad, the tactile images, and the network that classifies them.

Importing this package registers the Gymnasium environments where Gymnasium is installed (decision 0001); it does not
load MuJoCo or torch. The sensor with its observation models, and the functions ``compare`` and ``make_sensor`` of the
package ``experiments`` (decision 0034), are loaded at first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from activetouch.own_packages import require_own_packages

require_own_packages("belief")

from activetouch import envs
from activetouch.named_scenes import SCENES
from activetouch.poses import POSES
from activetouch.scene import Dynamic, Quasistatic, Scene
from activetouch.shapes import SHAPES
from belief.naming import later

if TYPE_CHECKING:
    from activetouch.mesh_source import read_meshes
    from activetouch.pad_file import PadDescription, read_pad
    from activetouch.pressing.height_maps import Window, predicted_contacts
    from activetouch.pressing.taxels import Taxels
    from activetouch.rendering.response import Response
    from activetouch.sensor import RecordedSensor, Sensor, TactileSensor
    from activetouch.sensor.any_pad import sensor_of_pad
    from activetouch.world import TouchWorld

_OF_COMMANDS = {
    "calibration_report": "calibration.calibration_report",
    "certify": "search.certify",
    "compare": "search.comparison",
    "drawer": "search.drawer.drawer",
    "find": "meshes.find",
    "identify": "meshes.identify",
    "make_sensor": "sensor.make_sensor",
    "on_cluster": "parallel.cluster",
}  # functions by the modules of experiments

__all__ = [
    "POSES",
    "SCENES",
    "SHAPES",
    "Dynamic",
    "PadDescription",
    "Quasistatic",
    "RecordedSensor",
    "Response",
    "Scene",
    "Sensor",
    "TactileSensor",
    "Taxels",
    "TouchWorld",
    "Window",
    "calibration_report",
    "certify",
    "compare",
    "envs",
    "find",
    "identify",
    "make_sensor",
    "on_cluster",
    "predicted_contacts",
    "read_meshes",
    "read_pad",
    "sensor_of_pad",
]


_load, __dir__ = later(__name__)


def __getattr__(name: str) -> Any:
    """The value of a lazily loaded name, or the version."""
    if name in _OF_COMMANDS:
        require_own_packages("planners", "experiments")
        return getattr(importlib.import_module(f"experiments.{_OF_COMMANDS[name]}"), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("activetouch")
    return _load(name)
