"""The world: shapes pressed against a tactile pad in MuJoCo, the images they leave, and the network that reads them.

Importing this package loads neither MuJoCo nor torch; what needs them loads them when used. It registers the Gymnasium
environments (decision 0025).
"""

from __future__ import annotations

from activetouch import envs
from activetouch.named_scenes import SCENES
from activetouch.poses import POSES
from activetouch.scene import Dynamic, Quasistatic, Scene
from activetouch.shapes import SHAPES
from activetouch.world import TactileSensor, TouchWorld

__all__ = ["POSES", "SCENES", "SHAPES", "Dynamic", "Quasistatic", "Scene", "TactileSensor", "TouchWorld", "envs"]


def __getattr__(name: str) -> str:
    if name == "__version__":
        from importlib.metadata import version

        return version("activetouch")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
