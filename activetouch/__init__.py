"""The simulated world: shapes pressed against a tactile pad, the tactile images, and the network that classifies them.

Importing this package registers the Gymnasium environments where Gymnasium is installed (decision 0025); it does not
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

if TYPE_CHECKING:
    from activetouch.pressing.height_maps import Window, predicted_contacts
    from activetouch.sensor import RecordedSensor, Sensor, TactileSensor
    from activetouch.world import TouchWorld

_LATER = {
    "RecordedSensor": "activetouch.sensor",
    "Sensor": "activetouch.sensor",
    "TactileSensor": "activetouch.sensor",
    "TouchWorld": "activetouch.world",
    "calibration_report": "experiments.calibration.calibration_report",
    "certify": "experiments.search.certify",
    "compare": "experiments.search.comparison",
    "find": "experiments.meshes.find",
    "identify": "experiments.meshes.identify",
    "make_sensor": "experiments.sensor.make_sensor",
    "predicted_contacts": "activetouch.pressing.height_maps",
    "read_meshes": "activetouch.mesh_source",
    "Window": "activetouch.pressing.height_maps",
}

__all__ = [
    "POSES",
    "SCENES",
    "SHAPES",
    "Dynamic",
    "Quasistatic",
    "RecordedSensor",
    "Scene",
    "Sensor",
    "TactileSensor",
    "TouchWorld",
    "Window",
    "calibration_report",
    "certify",
    "compare",
    "envs",
    "find",
    "identify",
    "make_sensor",
    "predicted_contacts",
    "read_meshes",
]


def __getattr__(name: str) -> Any:
    """The value of a lazily loaded name, or the version."""
    if name in _LATER:
        if _LATER[name].startswith("experiments."):
            require_own_packages("planners", "experiments")
        return getattr(importlib.import_module(_LATER[name]), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("activetouch")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
