"""Configurations of the trade-off between speed and accuracy.

A configuration has a readable name and a key for file names. The key is a digest of everything that determines the
result, including the contents of the reader and of a shipped observation model.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType

from activetouch.named_scenes import SCENES
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import OBSERVATION_FILE, READER_FILE
from belief.observation_model.registry import OBSERVATION_MODELS
from experiments.scene_choice import FIDELITIES, SceneChoice
from experiments.search.setting import Setting
from experiments.sensor_choice import independent_sensor
from planners import DECIDERS
from planners.registry import NEED_FILES

SHIPPED = "shipped"
"""Name of the observation model that is shipped with a scene's sensor of independent touches."""
FITTED = "ratio"
"""Kind of observation model that is fitted for networks without a shipped one; the shipped models are of this kind."""
JOINT = "rigid body"
"""Kind of joint observation model that is fitted for networks that know orientation."""
NUM_HYPOTHESES = (64, 256, 1024, 2048, 4096, 16_384)
"""Numbers of hypotheses of each shape to measure: the dial of speed against accuracy of a joint model."""
VARIED = ("decider", "touch cost λ", "network", "hypotheses", "observation model", "fidelity")
"""Properties that differ from a scene's default; see :attr:`Configuration.varied`."""
SHARES: Mapping[str, float] = MappingProxyType({"gel": 1.0, "coarse": 0.6, "paper": 0.3, "hard": 0.16, "many": 0.1})
"""Number of searches per target relative to ``gel``, chosen such that all scenes take about the same time."""
_WHOLE = ("gel", "coarse")  # scenes in which everything is varied
_MAIN = ("point_based", "information_gain", "threshold", "value_of_information")
_JOINT_DECIDER = "information_gain"
_TREES = ("pouct", "pomcp")  # deciders that use simulations for each decision
_TOUCH_COSTS = (0.005, 0.05, 0.1)  # besides the default


@dataclass(frozen=True)
class Network:
    """A trained reader.

    Attributes:
        scene: scene that it was trained for.
        file: its file; the shipped one if empty.
        label: backbone and edge length of its input images, such as "cnn 64 px".
        sha256: digest of the file.
        knows_orientation: whether it embeds hypotheses, which a joint observation model needs.
    """

    scene: str
    file: str
    label: str
    sha256: str
    knows_orientation: bool = False

    @classmethod
    def of(cls, scene: str, file: Path | None = None) -> Network:
        """The reader in a file; the shipped one of the scene by default.

        Raises:
            CorruptFile: The file does not contain a reader.
            LabelMismatch: The reader has other shapes or poses than the scene.
        """
        path = file if file is not None else independent_sensor(scene) / READER_FILE
        card, world = TactileReader.load(path).card, SCENES[scene].scene
        card.require_labels(world.shape_labels, world.pose_labels)
        label = f"{card.backbone} {card.input_size} px"
        return cls(scene, "" if file is None else str(file), label, _digest(path), bool(card.embedding))

    @property
    def path(self) -> Path:
        """Path of its file."""
        return Path(self.file) if self.file else independent_sensor(self.scene) / READER_FILE


@dataclass(frozen=True)
class Configuration:
    """A combination of sensor, decider and touch cost.

    Attributes:
        network: reader; determines the scene.
        observation_model: :data:`SHIPPED`, or the name of one.
        decider: key of :data:`planners.DECIDERS`.
        touch_cost: cost λ of one touch.
        fidelity: press model; that of the scene by default.
        simulations: simulations per decision of tree searches.
        episodes: searches per target.
        seed: seed of the episodes.
        num_hypotheses: of each shape, of a joint observation model that is fitted; None for any other.
    """

    network: Network
    observation_model: str = SHIPPED
    decider: str = _MAIN[0]
    touch_cost: float = 0.02
    fidelity: str | None = None
    simulations: int = 1000
    episodes: int = 250
    seed: int = 0
    num_hypotheses: int | None = None

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return self.network.scene

    @property
    def name(self) -> str:
        """Description in one line."""
        model = self.observation_model + (f" × {self.num_hypotheses}" if self.num_hypotheses else "")
        parts = [self.scene, self.network.label, model, self.decider, f"λ {self.touch_cost:g}"]
        if self.decider in _TREES:
            parts[-2] += f" × {self.simulations}"
        return ", ".join([*parts, *([self.fidelity] if self.fidelity else [])])

    @property
    def varied(self) -> str:
        """The property that differs from the scene's default; "nothing" for the default itself."""
        default = Configuration(self.network)
        differs = {
            "hypotheses": self.num_hypotheses is not None,
            "network": bool(self.network.file),
            "observation model": self.observation_model != default.observation_model,
            "fidelity": self.fidelity != default.fidelity,
            "touch cost λ": self.touch_cost != default.touch_cost,
            "decider": self.decider != default.decider,
        }
        return next((what for what in differs if differs[what]), "nothing")

    @property
    def key(self) -> str:
        """Digest of everything that determines the result; independent of the reader's path."""
        fields = asdict(self)
        del fields["network"]["file"], fields["network"]["knows_orientation"]
        if self.decider not in _TREES:
            del fields["simulations"]  # they have no effect
        if self.num_hypotheses is None:
            del fields["num_hypotheses"]
        if self.observation_model == SHIPPED:
            fields["observation_model"] = _digest(independent_sensor(self.scene) / OBSERVATION_FILE)
        return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def setting(self) -> Setting:
        """The setting of a comparison with this configuration."""
        return Setting(SceneChoice(self.scene, self.fidelity), touch_cost=self.touch_cost)

    def command(self, sensor: Path | None) -> str:
        """The ``compare`` command for this configuration; ``sensor`` is the folder of its sensor, None if shipped."""
        named = sensor if sensor is not None else independent_sensor(self.scene).name
        words = [f"activetouch compare --scene {self.scene} --deciders {self.decider} --touch-cost {self.touch_cost:g}"]
        words += [f"--fidelity {self.fidelity}"] if self.fidelity else []
        words += [f"--sensor {named}"]
        return " ".join([*words, f"--out runs/compare-{self.key}"])


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def sweep(networks: Sequence[Network], calibrated: Sequence[str], episodes: int, seed: int) -> list[Configuration]:
    """Configurations that differ from a scene's default in one property, most important first, without duplicates.

    Args:
        networks: readers; the first one of a scene is its default.
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
    # Force patches need a guarded move, and deformable pads take seconds per press.
    presses = [] if base.scene == "paper" else [name for name in FIDELITIES if name != "deformable"]
    refitted = [replace(base, network=network, observation_model=FITTED) for network in others]
    joint = [
        replace(base, network=network, observation_model=JOINT, num_hypotheses=number, decider=_JOINT_DECIDER)
        for network in (base.network, *others)
        if network.knows_orientation
        for number in NUM_HYPOTHESES
    ]
    not_varied = {"random_confirm", *NEED_FILES, *_TREES}
    fewer = max(1, base.episodes // 20)  # decisions of tree searches take hundreds of times as long
    return [
        [replace(base, decider=decider) for decider in _MAIN],
        [
            replace(base, decider=decider, touch_cost=touch_cost)
            for decider in ((_MAIN[0], "value_of_information") if is_whole else _MAIN[:1])
            for touch_cost in _TOUCH_COSTS
        ],
        [*refitted, *joint],
        [replace(base, fidelity=name) for name in presses if type(FIDELITIES[name]) is not type(own)],
        [replace(base, observation_model=model) for model in OBSERVATION_MODELS if is_whole and model != FITTED],
        [replace(base, decider=decider) for decider in DECIDERS if is_whole and decider not in not_varied],
        [
            replace(base, decider=decider, simulations=simulations, episodes=fewer)
            for decider in (_TREES if is_whole else ())
            for simulations in (100, 1000)
        ],
    ]
