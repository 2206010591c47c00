"""Configurations of the trade-off between speed and accuracy.

A configuration has a readable name and a key for file names. The key is a digest of everything that determines the
result, including the version of this package and the files of the sensor.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType

from activetouch.named_scenes import SCENES
from activetouch.sensor_files import INDEPENDENT_SUFFIX, MODELS
from experiments.scene_choice import FIDELITIES, SceneChoice, command
from experiments.search.fingerprint import files_digest
from experiments.search.setting import Setting
from planners import DECIDERS
from planners.registry import NEED_FILES

VARIED = ("decider", "touch cost λ", "sensor", "fidelity")
"""Properties that differ from a scene's default; see :attr:`Configuration.varied`."""
SHARES: Mapping[str, float] = MappingProxyType({"gel": 1.0, "coarse": 1.0, "paper": 0.6, "hard": 0.2, "many": 0.16})
"""Number of searches per target relative to ``gel``: fewer where they take longer."""
_WHOLE = ("gel", "coarse")  # scenes in which everything is varied
_MAIN = ("information_gain", "point_based", "threshold", "value_of_information")
_SLOW = ("pouct", "pomcp")  # tree searches, whose decisions take hundreds of times as long
_TOUCH_COSTS = (0.005, 0.05, 0.1)  # besides the default
_WEIGH_COSTS = ("point_based", "value_of_information")  # deciders that weigh the cost of a touch


@dataclass(frozen=True)
class Configuration:
    """A combination of sensor, decider, touch cost and press.

    Attributes:
        scene: name of the scene.
        sensor: name of a shipped sensor, or folder of one; that of the scene by default.
        decider: key of :data:`planners.DECIDERS`.
        touch_cost: cost λ of one touch.
        fidelity: press model; that of the scene by default.
        episodes: searches per target.
        seed: seed of the episodes.
    """

    scene: str
    sensor: str = ""
    decider: str = _MAIN[0]
    touch_cost: float = 0.02
    fidelity: str | None = None
    episodes: int = 250
    seed: int = 0

    @property
    def folder(self) -> Path:
        """Folder of the sensor."""
        shipped = MODELS / (self.sensor or self.scene)
        return shipped if shipped.is_dir() else Path(self.sensor)

    @property
    def name(self) -> str:
        """Description in one line: sensor, decider, touch cost, and press if it is not the scene's."""
        shipped = self.folder.parent == MODELS
        parts = [self.folder.name if shipped else f"{self.scene}, {self.sensor}", self.decider]
        return ", ".join([*parts, f"λ {self.touch_cost:g}", *([self.fidelity] if self.fidelity else [])])

    @property
    def varied(self) -> str:
        """The property that differs from the scene's default; "nothing" for the default itself."""
        differs = {
            "sensor": self.sensor not in ("", self.scene),
            "fidelity": self.fidelity is not None,
            "touch cost λ": self.touch_cost != Configuration.touch_cost,
            "decider": self.decider != Configuration.decider,
        }
        return next((what for what in differs if differs[what]), "nothing")

    @property
    def number(self) -> float | None:
        """The setting, if configurations that differ in a number are joined by a line."""
        return -self.touch_cost if self.varied == "touch cost λ" else None

    @property
    def key(self) -> str:
        """Digest of everything that determines the result; independent of where the sensor lies."""
        files = files_digest(path for path in sorted(self.folder.iterdir()) if path.is_file())
        fields = {**asdict(self), "sensor": files, "version": version("activetouch")}
        return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def setting(self) -> Setting:
        """The setting of a comparison with this configuration."""
        return Setting(SceneChoice(self.scene, self.fidelity), touch_cost=self.touch_cost)

    def command(self) -> str:
        """The ``compare`` command for this configuration."""
        return command(
            "compare",
            scene=self.scene,
            deciders=self.decider,
            touch_cost=f"{self.touch_cost:g}",
            fidelity=self.fidelity,
            sensor=None if self.varied != "sensor" else self.sensor,
            out=f"runs/compare-{self.key}",
        )


def sweep(scenes: Sequence[str], sensors: Mapping[str, Sequence[str]], episodes: int, seed: int) -> list[Configuration]:
    """Configurations that differ from a scene's default in one property, most important first, without duplicates.

    Those of another sensor are played by two deciders, because the best decider depends on the sensor.

    Args:
        scenes: to measure.
        sensors: folders of further sensors, by scene.
        episodes: searches per target of ``gel``; other scenes have fewer, see :data:`SHARES`.
        seed: seed of the episodes.
    """
    ordered = [scene for scene in SHARES if scene in scenes]
    bases = [Configuration(scene, episodes=max(1, round(episodes * SHARES[scene])), seed=seed) for scene in ordered]
    variants = [_variants(base, sensors.get(base.scene, ())) for base in bases]
    by_importance = (option for groups in zip(*variants, strict=True) for group in groups for option in group)
    return list(dict.fromkeys(by_importance))


def _variants(base: Configuration, sensors: Sequence[str]) -> list[list[Configuration]]:
    """Variants of a scene's default in groups, most important first."""
    own, is_whole = SCENES[base.scene].scene.press_model, base.scene in _WHOLE
    presses = [] if base.scene == "paper" else list(FIDELITIES)  # force patches need a guarded move
    independent = base.scene + INDEPENDENT_SUFFIX
    others = [*([independent] if (MODELS / independent).is_dir() else []), *sensors]
    not_varied = {"random_confirm", *NEED_FILES, *_SLOW}
    return [
        [replace(base, decider=decider) for decider in _MAIN],
        [replace(base, sensor=sensor, decider=decider) for sensor in others for decider in _MAIN[:2]],
        [
            replace(base, decider=decider, touch_cost=touch_cost)
            for decider in (_WEIGH_COSTS if is_whole else _WEIGH_COSTS[:1])
            for touch_cost in _TOUCH_COSTS
        ],
        [replace(base, fidelity=name) for name in presses if type(FIDELITIES[name]) is not type(own)],
        [replace(base, decider=decider) for decider in DECIDERS if is_whole and decider not in not_varied],
    ]
