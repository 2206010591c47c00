"""Configurations of the trade-off between speed and accuracy.

A configuration has a readable name and a key for file names. The key is a digest of everything that determines the
result, including the version of this package and the contents of the reader and of a sensor's observation model.
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
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import (
    INDEPENDENT_SUFFIX,
    MODELS,
    OBSERVATION_FILE,
    READER_FILE,
)
from belief.files import require_regular_file
from experiments.scene_choice import FIDELITIES, SceneChoice
from experiments.search.setting import Setting
from experiments.sensor_commands import command
from planners import DECIDERS
from planners.registry import NEED_FILES

SHIPPED = "shipped"
"""Name of the observation model that belongs to a shipped sensor."""
FITTED = "ratio"
"""Kind of observation model that is fitted for networks that read shapes only."""
JOINT = "rigid body"
"""Kind of joint observation model that is fitted for networks that know orientation."""
NUM_HYPOTHESES = (64, 256, 1024, 2048, 4096, 16_384)
"""Numbers of hypotheses of each shape to measure: the dial of speed against accuracy of a joint model."""
VARIED = ("decider", "touch cost λ", "sensor", "network", "hypotheses", "fidelity")
"""Properties that differ from a scene's default; see :attr:`Configuration.varied`."""
SHARES: Mapping[str, float] = MappingProxyType({"gel": 1.0, "coarse": 1.0, "paper": 0.6, "hard": 0.2, "many": 0.16})
"""Number of searches per target relative to ``gel``: fewer where they take longer."""
_WHOLE = ("gel", "coarse")  # scenes in which everything is varied
_MAIN = ("information_gain", "point_based", "threshold", "value_of_information")
_USUAL_HYPOTHESES = 2048
_TOUCH_COSTS = (0.005, 0.05, 0.1)  # besides the default
_WEIGH_COSTS = ("point_based", "value_of_information")  # deciders that weigh the cost of a touch


@dataclass(frozen=True)
class Network:
    """A trained reader.

    Attributes:
        scene: scene that it was trained for.
        sensor: name of the shipped sensor that it belongs to; empty for a reader in a file of the user's.
        file: this file; empty for the reader of a shipped sensor.
        label: backbone and edge length of its input images, such as "cnn 64 px".
        sha256: digest of the file.
        knows_orientation: whether it embeds hypotheses, which a joint observation model needs.
    """

    scene: str
    sensor: str
    file: str
    label: str
    sha256: str
    knows_orientation: bool = False

    @classmethod
    def of_sensor(cls, scene: str, sensor: str) -> Network:
        """The reader of a shipped sensor."""
        return cls._read(scene, sensor, "", MODELS / sensor / READER_FILE)

    @classmethod
    def in_file(cls, scene: str, file: Path) -> Network:
        """The reader in a file.

        Raises:
            CorruptFile: The file does not contain a reader.
            LabelMismatch: The reader has other shapes or poses than the scene.
        """
        return cls._read(scene, "", str(file), file)

    @classmethod
    def _read(cls, scene: str, sensor: str, file: str, path: Path) -> Network:
        card, world = TactileReader.load(path).card, SCENES[scene].scene
        card.require_labels(world.shape_labels, world.pose_labels)
        return cls(scene, sensor, file, f"{card.backbone} {card.input_size} px", _digest(path), bool(card.embedding))

    @property
    def path(self) -> Path:
        """Path of its file."""
        return Path(self.file) if self.file else self.folder / READER_FILE

    @property
    def folder(self) -> Path:
        """Folder of its sensor; for a file of the user's, of the default sensor of the scene."""
        return MODELS / (self.sensor or self.scene)


def shipped_networks(scene: str) -> list[Network]:
    """The readers of all shipped sensors of a scene; the default sensor first."""
    names = [scene, scene + INDEPENDENT_SUFFIX]
    return [Network.of_sensor(scene, name) for name in names if (MODELS / name).is_dir()]


@dataclass(frozen=True)
class Configuration:
    """A combination of sensor, decider and touch cost.

    Attributes:
        network: reader; determines the scene.
        observation_model: :data:`SHIPPED` for that of the network's sensor, or the kind of one to fit.
        decider: key of :data:`planners.DECIDERS`.
        touch_cost: cost λ of one touch.
        fidelity: press model; that of the scene by default.
        episodes: searches per target.
        seed: seed of the episodes.
        num_hypotheses: of each shape, of a joint observation model that is fitted; None for any other.
    """

    network: Network
    observation_model: str = SHIPPED
    decider: str = _MAIN[0]
    touch_cost: float = 0.02
    fidelity: str | None = None
    episodes: int = 250
    seed: int = 0
    num_hypotheses: int | None = None

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return self.network.scene

    @property
    def name(self) -> str:
        """Description in one line: sensor, or scene and network; observation model if it is fitted; decider."""
        network, model = self.network, self.observation_model
        parts = [network.sensor or f"{self.scene}, {network.label}"]
        if model != SHIPPED:
            parts.append(model + (f" × {self.num_hypotheses}" if self.num_hypotheses else ""))
        parts.append(self.decider)
        return ", ".join([*parts, f"λ {self.touch_cost:g}", *([self.fidelity] if self.fidelity else [])])

    @property
    def varied(self) -> str:
        """The property that differs from the scene's default; "nothing" for the default itself."""
        differs = {
            "network": not self.network.sensor,
            "hypotheses": self.num_hypotheses is not None,
            "sensor": self.network.sensor != self.scene,
            "fidelity": self.fidelity is not None,
            "touch cost λ": self.touch_cost != Configuration.touch_cost,
            "decider": self.decider != Configuration.decider,
        }
        return next((what for what in differs if differs[what]), "nothing")

    @property
    def key(self) -> str:
        """Digest of everything that determines the result; independent of the reader's path."""
        fields = {**asdict(self), "version": version("activetouch")}
        del fields["network"]["file"], fields["network"]["knows_orientation"]
        if self.num_hypotheses is None:
            del fields["num_hypotheses"]
        if self.observation_model == SHIPPED:
            fields["observation_model"] = _digest(self.network.folder / OBSERVATION_FILE)
        return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def setting(self) -> Setting:
        """The setting of a comparison with this configuration."""
        return Setting(SceneChoice(self.scene, self.fidelity), touch_cost=self.touch_cost)

    def command(self, sensor: Path) -> str:
        """The ``compare`` command for this configuration with the sensor in a folder."""
        return command(
            "compare",
            scene=self.scene,
            deciders=self.decider,
            touch_cost=f"{self.touch_cost:g}",
            fidelity=self.fidelity,
            sensor=None
            if sensor == MODELS / self.scene
            else self.network.sensor
            if sensor.parent == MODELS
            else sensor,
            out=f"runs/compare-{self.key}",
        )


def _digest(path: Path) -> str:
    return hashlib.sha256(require_regular_file(path).read_bytes()).hexdigest()


def sweep(networks: Sequence[Network], calibrated: Sequence[str], episodes: int, seed: int) -> list[Configuration]:
    """Configurations that differ from a scene's default in one property, most important first, without duplicates.

    Those of another sensor are played by two deciders, because the best decider depends on the sensor.

    Args:
        networks: readers; the first one of a scene is that of its default sensor.
        calibrated: scenes with recorded touches to fit observation models to.
        episodes: searches per target of ``gel``; other scenes have fewer, see :data:`SHARES`.
        seed: seed of the episodes.
    """
    defaults = {network.scene: network for network in reversed(networks)}
    bases = [
        Configuration(network, episodes=max(1, round(episodes * SHARES[scene])), seed=seed)
        for scene, network in sorted(defaults.items(), key=lambda pair: list(SHARES).index(pair[0]))
    ]
    variants = [_variants(base, [n for n in networks if n.scene == base.scene and n != base.network]) for base in bases]
    by_importance = (option for groups in zip(*variants, strict=True) for group in groups for option in group)
    found = {option.key: option for option in by_importance}
    return [c for c in found.values() if c.observation_model == SHIPPED or c.scene in calibrated]


def _variants(base: Configuration, others: Sequence[Network]) -> list[list[Configuration]]:
    """Variants of a scene's default in groups, most important first; ``others`` are further networks of the scene."""
    own, is_whole = SCENES[base.scene].scene.press_model, base.scene in _WHOLE
    presses = [] if base.scene == "paper" else list(FIDELITIES)  # force patches need a guarded move
    joint = replace(base, observation_model=JOINT, num_hypotheses=_USUAL_HYPOTHESES)
    not_varied = {"random_confirm", *NEED_FILES}
    return [
        [replace(base, decider=decider) for decider in _MAIN],
        [replace(base, network=n, decider=decider) for n in others if n.sensor for decider in _MAIN[:2]],
        [
            replace(base, decider=decider, touch_cost=touch_cost)
            for decider in (_WEIGH_COSTS if is_whole else _WEIGH_COSTS[:1])
            for touch_cost in _TOUCH_COSTS
        ],
        [
            replace(joint if n.knows_orientation else replace(base, observation_model=FITTED), network=n)
            for n in others
            if not n.sensor
        ],
        [replace(joint, num_hypotheses=number) for number in NUM_HYPOTHESES if base.network.knows_orientation],
        [replace(base, fidelity=name) for name in presses if type(FIDELITIES[name]) is not type(own)],
        [replace(base, decider=decider) for decider in DECIDERS if is_whole and decider not in not_varied],
    ]
