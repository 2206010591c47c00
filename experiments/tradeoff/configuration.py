"""Configurations of the trade-off: a scene's default, and what differs from it in one thing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from activetouch.named_scenes import SCENES
from activetouch.sensor_files import INDEPENDENT_SUFFIX, MODELS
from experiments.scene_choice import FIDELITIES, command
from planners import DECIDERS
from planners.registry import NEED_FILES

SHARES: Mapping[str, float] = MappingProxyType({"gel": 1.0, "coarse": 1.0, "paper": 0.6, "hard": 0.2, "many": 0.16})
"""Number of searches per target relative to ``gel``: fewer where they take longer."""
_WHOLE = ("gel", "coarse")  # scenes in which everything is varied
_MAIN = ("information_gain", "point_based", "threshold", "value_of_information")
_SLOW = ("pouct",)  # tree search, whose decisions take hundreds of times as long
_TOUCH_COSTS = (0.005, 0.05, 0.1)  # besides the default
_WEIGH_COSTS = ("point_based", "value_of_information")  # deciders that weigh the cost of a touch


@dataclass(frozen=True)
class Configuration:
    """A combination of sensor, decider, touch cost and press.

    Attributes:
        scene: name of the scene.
        sensor: name of a shipped sensor, or folder of one; empty for that of the scene.
        decider: key of :data:`planners.DECIDERS`.
        touch_cost: cost λ of one touch.
        fidelity: press model; None for that of the scene.
    """

    scene: str
    sensor: str = ""
    decider: str = _MAIN[0]
    touch_cost: float = 0.02
    fidelity: str | None = None

    @property
    def name(self) -> str:
        """Description in one line: sensor, decider, touch cost, and press if it is not the scene's."""
        own = not self.sensor or (MODELS / self.sensor).is_dir()
        parts = [(self.sensor or self.scene) if own else f"{self.scene}, {Path(self.sensor).name}", self.decider]
        return ", ".join([*parts, f"λ {self.touch_cost:g}", *([self.fidelity] if self.fidelity else [])])

    @property
    def varied(self) -> str:
        """The property that differs from the scene's default; "nothing" for the default itself."""
        differs = {
            "sensor": self.sensor != "",
            "fidelity": self.fidelity is not None,
            "touch cost λ": self.touch_cost != Configuration.touch_cost,
            "decider": self.decider != Configuration.decider,
        }
        return next((what for what in differs if differs[what]), "nothing")

    @property
    def number(self) -> float | None:
        """The setting, if configurations that differ in a number are joined by a line."""
        return -self.touch_cost if self.varied == "touch cost λ" else None

    def command(self) -> str:
        """The ``compare`` command for this configuration."""
        return command(
            "compare",
            scene=self.scene,
            deciders=self.decider,
            touch_cost=f"{self.touch_cost:g}",
            fidelity=self.fidelity,
            sensor=self.sensor or None,
        )


def sweep(scenes: Sequence[str], sensors: Mapping[str, Sequence[str]]) -> list[Configuration]:
    """Configurations that differ from a scene's default in one property, without duplicates, the defaults first.

    Those of another sensor are played by two deciders, because the best decider depends on the sensor.

    Args:
        scenes: to measure.
        sensors: folders of further sensors, by scene.
    """
    found = [one for scene in SHARES if scene in scenes for one in _variants(scene, sensors.get(scene, ()))]
    return list(dict.fromkeys(found))


def _variants(scene: str, sensors: Sequence[str]) -> list[Configuration]:
    base, own, is_whole = Configuration(scene), SCENES[scene].scene.press_model, scene in _WHOLE
    presses = [] if scene == "paper" else list(FIDELITIES)  # force patches need a guarded move
    independent = scene + INDEPENDENT_SUFFIX
    others = [*([independent] if (MODELS / independent).is_dir() else []), *sensors]
    not_varied = {"random_confirm", *NEED_FILES, *_SLOW}
    return [
        *(replace(base, decider=decider) for decider in _MAIN),
        *(replace(base, sensor=sensor, decider=decider) for sensor in others for decider in _MAIN[:2]),
        *(
            replace(base, decider=decider, touch_cost=touch_cost)
            for decider in (_WEIGH_COSTS if is_whole else _WEIGH_COSTS[:1])
            for touch_cost in _TOUCH_COSTS
        ),
        *(replace(base, fidelity=name) for name in presses if type(FIDELITIES[name]) is not type(own)),
        *(replace(base, decider=decider) for decider in DECIDERS if is_whole and decider not in not_varied),
    ]
