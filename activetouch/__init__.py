"""The world: shapes pressed against a tactile pad in MuJoCo, the images they leave, and the network that reads them.

Importing this package loads neither MuJoCo nor torch; what needs them loads them when used. It registers the Gymnasium
environments (decision 0025). ``compare`` and ``make_sensor`` are functions of the package ``experiments``, which lies
above this one; they are loaded when first asked for (decision 0034).
"""

from __future__ import annotations

import importlib
from typing import Any

from activetouch import envs
from activetouch.named_scenes import SCENES
from activetouch.poses import POSES
from activetouch.scene import Dynamic, Quasistatic, Scene
from activetouch.shapes import SHAPES
from activetouch.world import TactileSensor, TouchWorld

_ABOVE = {"compare": "experiments.search.objects", "make_sensor": "experiments.sensor.make_sensor"}

__all__ = [
    "POSES",
    "SCENES",
    "SHAPES",
    "Dynamic",
    "Quasistatic",
    "Scene",
    "TactileSensor",
    "TouchWorld",
    "compare",
    "envs",
    "make_sensor",
]


def __getattr__(name: str) -> Any:
    """The functions that are loaded when first asked for."""
    if name in _ABOVE:
        return getattr(importlib.import_module(_ABOVE[name]), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("activetouch")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
