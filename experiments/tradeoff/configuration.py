"""What the trade between speed and accuracy is swept over: one frozen configuration for each point.

A configuration has a name for people and a key for files. The key follows from everything that decides the result, the
checkpoint and a shipped observation model by content, so that a result is found again wherever it was measured, and
never mistaken for another.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from activetouch.named_scenes import SCENES
from activetouch.world import CLASSIFIER_FILE, MODELS, OBSERVATION_FILE
from belief.observation_model.registry import OBSERVATION_MODELS
from experiments.scene_choice import FIDELITIES, SceneChoice
from experiments.search.setting import Setting
from planners import DECIDERS
from planners.registry import TRAINED

SHIPPED = "shipped"
"""Stands for the observation model that comes with a scene's sensor."""
FITTED = "ratio"
"""The kind of observation model of other networks, which is also the shipped sensors' kind."""
SHARES: Mapping[str, float] = MappingProxyType({"gel": 1.0, "coarse": 0.6, "paper": 0.3, "hard": 0.16, "many": 0.1})
"""Searches for each target, relative to ``gel``: so many that all scenes take about as long."""
_WHOLE = ("gel", "coarse")  # scenes in which everything is varied; elsewhere only what matters most
_MAIN = ("point_based", "information_gain", "threshold", "value_of_information")
_FLOOR = "random_confirm"
_TREES = ("pouct", "pomcp")  # deciders whose every decision takes simulations
_TOUCH_COSTS = (0.005, 0.05, 0.1)  # beside the default


@dataclass(frozen=True)
class Network:
    """A trained classifier.

    Attributes:
        scene: it was trained for.
        checkpoint: its file; the shipped one if empty.
        label: backbone and edge of the images that it sees, such as "cnn 64 px".
        sha256: of the file.
    """

    scene: str
    checkpoint: str
    label: str
    sha256: str

    @classmethod
    def of(cls, scene: str, checkpoint: Path | None = None) -> Network:
        """The classifier in a file; the shipped one of the scene by default.

        Raises:
            CorruptFile: there is no classifier in the file.
            LabelMismatch: it is for other shapes or poses than the scene has.
        """
        from activetouch.perception.classifier import TouchClassifier  # loads torch

        path = checkpoint if checkpoint is not None else MODELS / scene / CLASSIFIER_FILE
        classifier, felt = TouchClassifier.load(path), SCENES[scene].scene
        classifier.card.require_labels(felt.shape_labels, felt.pose_labels)
        label = f"{classifier.card.backbone} {classifier.card.input_size} px"
        return cls(scene, "" if checkpoint is None else str(checkpoint), label, _digest(path))

    @property
    def path(self) -> Path:
        """Of its file."""
        return Path(self.checkpoint) if self.checkpoint else MODELS / self.scene / CLASSIFIER_FILE


@dataclass(frozen=True)
class Configuration:
    """One way to search.

    Attributes:
        network: reads the images; decides the scene.
        precision: of its backbone's arithmetic.
        observation_model: :data:`SHIPPED`, or a key of :data:`belief.observation_model.selection.OBSERVATION_MODELS`,
        fitted anew.
        decider: a key of :data:`planners.DECIDERS`.
        touch_cost: λ.
        fidelity: how presses are made; the scene's own way by default.
        simulations: of each decision, for deciders that search a tree.
        episodes: searches for each target.
        seed: of the episodes.
    """

    network: Network
    precision: Literal["fp32", "bf16"] = "fp32"
    observation_model: str = SHIPPED
    decider: str = _MAIN[0]
    touch_cost: float = 0.02
    fidelity: str | None = None
    simulations: int = 1000
    episodes: int = 250
    seed: int = 0

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return self.network.scene

    @property
    def name(self) -> str:
        """What it is, in a line."""
        parts = [self.scene, self.network.label, self.observation_model, self.decider, f"λ {self.touch_cost:g}"]
        if self.precision != "fp32":
            parts.insert(2, self.precision)
        if self.decider in _TREES:
            parts[-2] += f" × {self.simulations}"
        return ", ".join([*parts, *([self.fidelity] if self.fidelity else [])])

    @property
    def varied(self) -> str:
        """What is other than in the scene's default, in a word; "nothing" for the default itself."""
        default = Configuration(self.network)
        differs = {
            "network": bool(self.network.checkpoint),
            "precision": self.precision != default.precision,
            "observation model": self.observation_model != default.observation_model,
            "fidelity": self.fidelity != default.fidelity,
            "touch cost λ": self.touch_cost != default.touch_cost,
            "decider": self.decider != default.decider,
        }
        return next((what for what in differs if differs[what]), "nothing")

    @property
    def key(self) -> str:
        """Of its result; the same wherever the checkpoint lies."""
        fields = asdict(self)
        del fields["network"]["checkpoint"]
        if self.decider not in _TREES:
            del fields["simulations"]  # which are of no effect
        if self.observation_model == SHIPPED:
            fields["observation_model"] = _digest(MODELS / self.scene / OBSERVATION_FILE)
        return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def setting(self) -> Setting:
        """The search, as a comparison has it."""
        return Setting(SceneChoice(self.scene, self.fidelity), touch_cost=self.touch_cost)

    def command(self, sensor: Path | None) -> str:
        """The comparison that plays it; ``sensor`` is a folder with its classifier and its observation model."""
        words = [f"activetouch compare --scene {self.scene} --deciders {self.decider} --touch-cost {self.touch_cost:g}"]
        words += [f"--fidelity {self.fidelity}"] if self.fidelity else []
        words += [f"--sensor {sensor}"] if sensor is not None else []
        return " ".join([*words, f"--out runs/compare-{self.key}"])


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def sweep(networks: Sequence[Network], calibrated: Sequence[str], episodes: int, seed: int) -> list[Configuration]:
    """All configurations, each once: one thing at a time is other than in a scene's default.

    What matters most comes first, in all scenes, so that an interrupted sweep is worth most.

    Args:
        networks: classifiers; the first of a scene is its default.
        calibrated: scenes with recorded touches to fit observation models to; the others keep what they come with.
        episodes: for each target of ``gel``, and as :data:`SHARES` says of the others.
        seed: of the episodes.
    """
    defaults = {network.scene: network for network in reversed(networks)}
    bases = [
        Configuration(network, episodes=max(1, round(episodes * SHARES[scene])), seed=seed)
        for scene, network in sorted(defaults.items(), key=lambda pair: list(SHARES).index(pair[0]))
    ]
    found: dict[str, Configuration] = {}
    for vary in (_main_deciders, _touch_costs, _networks, _fidelities, _models, _deciders, _half_precision, _trees):
        for base in bases:
            others = [network for network in networks if network.scene == base.scene and network != base.network]
            found |= {option.key: option for option in vary(base, others)}
    return [c for c in found.values() if c.observation_model == SHIPPED or c.scene in calibrated]


def _main_deciders(base: Configuration, _: Sequence[Network]) -> Iterator[Configuration]:
    for decider in _MAIN:
        yield replace(base, decider=decider)


def _touch_costs(base: Configuration, _: Sequence[Network]) -> Iterator[Configuration]:
    for decider in (_MAIN[0], "value_of_information") if base.scene in _WHOLE else (_MAIN[0],):
        for touch_cost in _TOUCH_COSTS:
            yield replace(base, decider=decider, touch_cost=touch_cost)


def _networks(base: Configuration, others: Sequence[Network]) -> Iterator[Configuration]:
    for network in others:
        yield replace(base, network=network, observation_model=FITTED)


def _fidelities(base: Configuration, _: Sequence[Network]) -> Iterator[Configuration]:
    own = SCENES[base.scene].scene.press_model
    for fidelity, press in FIDELITIES.items():
        # A force patch is drawn from the course of a guarded move, and deformable pads take seconds a press.
        if fidelity != "deformable" and type(press) is not type(own) and base.scene != "paper":
            yield replace(base, fidelity=fidelity)


def _models(base: Configuration, _: Sequence[Network]) -> Iterator[Configuration]:
    for model in OBSERVATION_MODELS if base.scene in _WHOLE else ():
        if model != FITTED:
            yield replace(base, observation_model=model)


def _half_precision(base: Configuration, others: Sequence[Network]) -> Iterator[Configuration]:
    for option in (base, *_networks(base, others)):
        yield replace(option, precision="bf16")


def _deciders(base: Configuration, _: Sequence[Network]) -> Iterator[Configuration]:
    for decider in DECIDERS if base.scene in _WHOLE else ():
        if decider != _FLOOR and decider not in TRAINED and decider not in _TREES:
            yield replace(base, decider=decider)


def _trees(base: Configuration, _: Sequence[Network]) -> Iterator[Configuration]:
    """A twentieth of the searches, because their decisions take hundreds of times as long."""
    for decider in _TREES if base.scene in _WHOLE else ():
        for simulations in (100, 1000):
            fewer = max(1, base.episodes // 20)
            yield replace(base, decider=decider, simulations=simulations, episodes=fewer)
