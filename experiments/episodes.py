"""Play live episodes: which objects lie where follows from the seed alone, so every decider gets the same ones."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import tyro

from activetouch import Scene, TactileSensor, TouchWorld
from activetouch.world import MODELS, POLICIES, TouchTime
from belief import SearchProblem
from belief.chance import arrangement_rng
from belief.synthetic import sample_arrangement
from experiments.results import Seconds
from experiments.scene_choice import SceneChoice
from experiments.sensors import check_sensor, load_quietly
from planners import Episode, make_decider, search_lockstep

_TOUCHES_PER_OBJECT = 12  # until a search is cut off


@dataclass(frozen=True)
class Setting:
    """What all episodes of a run have in common."""

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    sensor: Path | None = None
    """Folder of a classifier and an observation model; those that come with the scene by default."""
    num_objects: int | None = None
    """Objects on the table; as many as the scene has by default."""
    touch_cost: float = 0.02
    """λ."""
    anyway: bool = False
    """Use the sensor in a scene that it was not made for; the report says how the two differ."""

    def to_dict(self) -> dict[str, Any]:
        """The setting as plain values."""
        sensor = None if self.sensor is None else str(self.sensor)
        return {**asdict(self), "choice": self.choice.to_dict(), "sensor": sensor}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Setting:
        """The setting from :meth:`to_dict`."""
        sensor = None if fields["sensor"] is None else Path(fields["sensor"])
        return cls(**{**fields, "choice": SceneChoice.from_dict(fields["choice"]), "sensor": sensor})

    def resolved(self) -> Setting:
        """The same setting with absolute paths, for workers that were started elsewhere."""
        meshes = tuple(path.resolve() for path in self.choice.meshes)
        sensor = None if self.sensor is None else self.sensor.resolve()
        return replace(self, choice=replace(self.choice, meshes=meshes), sensor=sensor)

    @property
    def scene(self) -> Scene:
        """The scene the episodes play in."""
        return self.choice.named.scene

    @property
    def sensor_folder(self) -> Path:
        """Where the classifier and the observation model are."""
        return self.sensor if self.sensor is not None else MODELS / self.choice.scene

    @property
    def shift(self) -> tuple[str, ...]:
        """How the scene differs from that of the sensor, or an error. See :func:`experiments.sensors.check_sensor`."""
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
            composition=named.composition,
            touch_cost=self.touch_cost,
            touch_limit=_TOUCHES_PER_OBJECT * num_objects,
        )


@lru_cache(maxsize=2)
def load_sensor(setting: Setting) -> TactileSensor:
    """The setting's sensor, loaded once a process."""
    import torch

    torch.set_num_threads(1)  # the processes share the cores, and sums keep their order
    return load_quietly(setting.sensor_folder, setting.scene, setting.anyway)  # the report tells a known shift


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
    sensor = load_sensor(setting)
    sensor = replace(sensor, time=TouchTime())
    seeds = [episode_seed(seed, target, number) for number in numbers]
    worlds = [make_world(setting, sensor, key) for key in seeds]
    chosen = make_decider(decider, sensor.model.outcome_table(), sensor.model, setting.sensor_folder / POLICIES)
    started = time.perf_counter()
    episodes = search_lockstep(
        worlds, chosen, setting.problem, [target] * len(worlds), sensor.model, seeds, sensor.touch_many
    )
    total = time.perf_counter() - started
    touches = sum(episode.num_touches for episode in episodes)
    thinking = total - sensor.time.physics - sensor.time.network
    spent = sensor.time
    return episodes, Seconds(spent.physics, spent.network, thinking, touches, spent.pressed_again)
