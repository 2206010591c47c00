"""Play live episodes: which objects lie where follows from the seed alone, so every decider gets the same ones."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import tyro

from activetouch import Scene, TactileSensor, TouchWorld
from activetouch.world import (
    CLASSIFIER_FILE,
    OBSERVATION_FILE,
    POLICIES,
    TouchTime,
    load_observation_model,
    touch_many,
)
from belief import Composition, SearchProblem, Touch
from belief.observation_model import ObservationModel, OutcomeTable
from belief.seeding import arrangement_rng
from belief.synthetic import sample_arrangement
from experiments.command_line.arguments import Count, NotNegative
from experiments.scene_choice import SceneChoice
from experiments.search.run_folder import Seconds
from experiments.sensor_choice import check_sensor, load_quietly, sensor_folder
from planners import Decider, Episode, make_decider, search_lockstep
from planners.search import TouchRequest

_TOUCHES_PER_OBJECT = 12  # until a search is cut off


@dataclass(frozen=True)
class Setting:
    """What all episodes of a run have in common."""

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    sensor: Path | None = None
    """Folder of a classifier and an observation model, or the name of a scene that they come with; those that come with
    the scene by default."""
    num_objects: Count | None = None
    """Objects on the table; as many as the scene has by default."""
    composition: Literal["distinct", "independent"] | None = None
    """Whether all objects differ in shape, or each may have any; as in the scene by default."""
    touch_cost: NotNegative = 0.02
    """Price of one touch, in units of a success (λ)."""
    anyway: bool = False
    """Use the sensor in a scene that it was not made for; the report says how the two differ."""

    def to_dict(self) -> dict[str, Any]:
        """The setting as plain values."""
        sensor = None if self.sensor is None else str(self.sensor)
        told = {field.name: getattr(self, field.name) for field in fields(Setting)}
        return {**told, "choice": self.choice.to_dict(), "sensor": sensor}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Setting:
        """The setting from :meth:`to_dict`."""
        sensor = None if fields["sensor"] is None else Path(fields["sensor"])
        return cls(**{**fields, "choice": SceneChoice.from_dict(fields["choice"]), "sensor": sensor})

    def resolved(self) -> Setting:
        """The same setting with absolute paths, for workers that were started elsewhere."""
        meshes = tuple(path.resolve() for path in self.choice.meshes)
        sensor = None if self.sensor is None else self.sensor_folder.resolve()
        return replace(self, choice=replace(self.choice, meshes=meshes), sensor=sensor)

    def player(self, name: str) -> Decider | str:
        """The decider that a report calls so, or its name as on the command line."""
        return name

    @property
    def scene(self) -> Scene:
        """The scene the episodes play in."""
        return self.choice.named.scene

    @property
    def sensor_folder(self) -> Path:
        """Where the classifier and the observation model are."""
        return sensor_folder(self.sensor, self.choice.scene)

    @property
    def shift(self) -> tuple[str, ...]:
        """How the scene differs from that of the sensor (:func:`experiments.sensor_choice.check_sensor`)."""
        return check_sensor(self.sensor_folder, self.choice, self.anyway)

    @property
    def problem(self) -> SearchProblem:
        """The rules of the search."""
        named = self.choice.named
        num_objects = named.num_objects if self.num_objects is None else self.num_objects
        return SearchProblem(
            self.scene.shape_labels,
            self.scene.pose_labels,
            num_objects=num_objects,
            composition=named.composition if self.composition is None else Composition(self.composition),
            touch_cost=self.touch_cost,
            touch_limit=_TOUCHES_PER_OBJECT * num_objects,
        )


Stamps: TypeAlias = tuple[tuple[int, int] | None, ...]
"""When files were last written, and how long they are: other stamps are other files."""


def stamps(setting: Setting) -> Stamps:
    """Of the files of the setting's sensor; what a process has read of others of that name does not count."""
    return tuple(_stamp(setting.sensor_folder / name) for name in (CLASSIFIER_FILE, OBSERVATION_FILE))


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def load_sensor(setting: Setting) -> TactileSensor:
    """The setting's sensor, loaded once a process, and again when its files were written anew."""
    return _load_sensor(setting, stamps(setting))


@lru_cache(maxsize=2)
def _load_sensor(setting: Setting, when: Stamps) -> TactileSensor:
    import torch

    torch.set_num_threads(1)  # the processes share the cores, and sums keep their order
    return load_quietly(setting.sensor_folder, setting.scene, setting.anyway)  # the report tells a known shift


def known_model(setting: Setting) -> tuple[ObservationModel, OutcomeTable]:
    """The sensor's observation model and its outcome table, without the network."""
    return _known_model(setting.sensor_folder, stamps(setting))


@lru_cache(maxsize=2)
def _known_model(folder: Path, when: Stamps) -> tuple[ObservationModel, OutcomeTable]:
    model = load_observation_model(folder)
    return model, model.outcome_table()


def build_decider(setting: Setting, name: str) -> Decider:
    """The named decider with the setting's observation model and policies."""
    player = setting.player(name)
    if not isinstance(player, str):
        return deepcopy(player)  # what it keeps from one shard is not to reach another
    model, table = known_model(setting)
    return make_decider(player, table, model, setting.sensor_folder / POLICIES)


def make_world(setting: Setting, sensor: TactileSensor, seed: tuple[int, ...]) -> TouchWorld:
    """The objects of the episode with this seed."""
    rng = arrangement_rng(seed)
    return TouchWorld.sample(sensor, sample_arrangement(setting.problem, rng), rng)


def episode_seed(seed: int, target: int, number: int) -> tuple[int, ...]:
    """Seed of one episode of a run."""
    return (seed, target, number)


def play(
    setting: Setting, decider: str, target: int, seed: int, numbers: Sequence[int]
) -> tuple[list[Episode], Seconds]:
    """Play episodes in lockstep: the same numbers give the same episodes, bit for bit, in any process."""
    sensor, spent = load_sensor(setting), [TouchTime()]
    seeds = [episode_seed(seed, target, number) for number in numbers]
    worlds = [make_world(setting, sensor, key) for key in seeds]
    chosen = build_decider(setting, decider)

    def touch_and_time(requests: Sequence[TouchRequest[TouchWorld]]) -> list[Touch]:
        touches, seconds = touch_many(sensor, requests)
        spent.append(seconds)
        return touches

    started = time.perf_counter()
    episodes = search_lockstep(
        worlds, chosen, setting.problem, [target] * len(worlds), sensor.model, seeds, touch_and_time
    )
    total = time.perf_counter() - started
    touches = sum(episode.num_touches for episode in episodes)
    seconds = sum(spent, TouchTime())
    thinking = total - seconds.physics - seconds.network
    return episodes, Seconds(seconds.physics, seconds.network, thinking, touches, seconds.pressed_again)
