"""What the trade between speed and accuracy is swept over: one frozen configuration for each point.

A configuration has a name for people and a key for files. The key follows from everything that decides the result, the
checkpoint and a shipped observation model by content, so that a result is found again wherever it was measured, and
never mistaken for another.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

from activetouch.scenes import SCENES
from activetouch.world import CLASSIFIER_FILE, MODELS, OBSERVATION_FILE
from belief.selection import OBSERVATION_MODELS
from experiments.episodes import Setting
from experiments.scene_choice import FIDELITIES, SceneChoice
from planners import DECIDERS
from planners.table import TRAINED

SHIPPED = "shipped"
"""Stands for the observation model that comes with a scene's sensor."""
_FLOOR = "random_confirm"
_TREES = ("pouct", "pomcp")  # deciders whose every decision takes simulations


@dataclass(frozen=True)
class Network:
    """A trained classifier.

    Attributes:
        scene: it was trained for.
        checkpoint: its file.
        label: backbone and edge of the images that it sees, such as "cnn 64 px".
        sha256: of the file.
    """

    scene: str
    checkpoint: str
    label: str
    sha256: str

    @classmethod
    def of(cls, scene: str, checkpoint: Path | None = None) -> Network:
        """The classifier in a file; the shipped one of the scene by default."""
        from activetouch.classifier import TouchClassifier  # loads torch

        path = checkpoint if checkpoint is not None else MODELS / scene / CLASSIFIER_FILE
        card = TouchClassifier.load(path).card
        digest = _digest(path)
        return cls(
            scene, "" if checkpoint is None else str(checkpoint), f"{card.backbone} {card.input_size} px", digest
        )

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
        observation_model: :data:`SHIPPED`, or a key of :data:`belief.selection.OBSERVATION_MODELS`, fitted anew.
        decider: a key of :data:`planners.DECIDERS`.
        touch_cost: λ.
        fidelity: how presses are made; the scene's own way by default.
        touches: "recorded" ones of unseen objects, or "live" ones, pressed in the search.
        simulations: of each decision, for deciders that search a tree.
        episodes: searches for each target.
        seed: of the episodes.
    """

    network: Network
    precision: Literal["fp32", "bf16"] = "fp32"
    observation_model: str = SHIPPED
    decider: str = "information_gain"
    touch_cost: float = 0.02
    fidelity: str | None = None
    touches: Literal["recorded", "live"] = "recorded"
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
        return ", ".join([*parts, *([self.fidelity] if self.fidelity else []), self.touches])

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
        return Setting(SceneChoice(self.scene, self.fidelity), touch_cost=self.touch_cost)  # type: ignore[arg-type]

    def command(self, sensor: Path | None) -> str:
        """The comparison that plays it live; ``sensor`` is a folder with its classifier and its observation model."""
        words = [f"activetouch compare --scene {self.scene} --deciders {self.decider} --touch-cost {self.touch_cost:g}"]
        words += [f"--fidelity {self.fidelity}"] if self.fidelity else []
        words += [f"--sensor {sensor}"] if sensor is not None else []
        return " ".join([*words, f"--out runs/compare-{self.key}"])


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def sweep(networks: Sequence[Network], recorded: Sequence[str], episodes: int, seed: int) -> list[Configuration]:
    """All configurations, each once: one thing at a time is other than in a scene's default.

    Args:
        networks: classifiers; the first of a scene is its default.
        recorded: scenes whose touches are recorded; the others are pressed live only.
        episodes: for each target of a scene with four shapes; fewer where a search takes longer.
        seed: of the episodes.
    """
    found: dict[str, Configuration] = {}
    defaults = {network.scene: network for network in reversed(networks)}
    for scene, network in defaults.items():
        base = Configuration(network, episodes=_scaled(episodes, scene), seed=seed)
        live = replace(base, touches="live", episodes=max(1, base.episodes // 10))
        options = [*_live(live)]
        if scene in recorded:
            options += [*_deciders(base), *_observation_models(base), *_touch_costs(base)]
            options += [
                replace(
                    base, network=other, precision=precision, observation_model=SHIPPED if other is network else "ratio"
                )
                for other in networks
                if other.scene == scene
                for precision in ("fp32", "bf16")
            ]
        found |= {option.key: option for option in options}
    return list(found.values())


def _scaled(episodes: int, scene: str) -> int:
    """As many touches, about, for scenes of more targets and objects."""
    named = SCENES[scene]
    return max(1, round(episodes * 16 / (len(named.scene.shapes) * named.num_objects)))


def _deciders(base: Configuration) -> Iterator[Configuration]:
    for decider in DECIDERS:
        if decider in _TREES:
            for simulations in (100, 1000):
                fewer = max(1, base.episodes // 20)  # they take hundreds of times as long
                yield replace(base, decider=decider, simulations=simulations, episodes=fewer)
        elif decider != _FLOOR and decider not in TRAINED:
            yield replace(base, decider=decider)


def _observation_models(base: Configuration) -> Iterator[Configuration]:
    for model in OBSERVATION_MODELS:
        yield replace(base, observation_model=model)


def _touch_costs(base: Configuration) -> Iterator[Configuration]:
    for decider in ("value_of_information", "point_based"):
        for touch_cost in (0.005, 0.05, 0.1):
            if decider in DECIDERS:
                yield replace(base, decider=decider, touch_cost=touch_cost)


def _live(base: Configuration) -> Iterator[Configuration]:
    yield base
    own = SCENES[base.scene].scene.press_model
    for fidelity, press in FIDELITIES.items():
        if fidelity != "deformable" and type(press) is not type(own) and base.scene != "paper":
            yield replace(base, fidelity=fidelity)
