"""Play live episodes: which objects lie where follows from the seed alone, so every decider gets the same ones."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from activetouch import Dynamic, Quasistatic, Scene, TactileSensor, TouchWorld
from activetouch.world import MODELS, TouchTime
from belief import SearchProblem
from belief.synthetic import sample_arrangement
from experiments.results import Seconds
from planners import Episode, make_decider, search_lockstep

_WORLD = 2  # stream of an episode's seed that makes the objects; the search loop has its own


@dataclass(frozen=True)
class Setting:
    """What all episodes of a run have in common.

    Attributes:
        sensor: folder of the classifier and the observation model.
        quasistatic: press without time stepping.
        num_objects: on the table.
        touch_cost: λ.
    """

    sensor: Path = MODELS / "gel"
    quasistatic: bool = False
    num_objects: int = 4
    touch_cost: float = 0.02

    def to_dict(self) -> dict[str, Any]:
        """The setting as plain values."""
        return {**asdict(self), "sensor": str(self.sensor)}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Setting:
        """The setting from :meth:`to_dict`."""
        return cls(**{**fields, "sensor": Path(fields["sensor"])})

    @property
    def scene(self) -> Scene:
        """The scene the episodes play in."""
        return Scene(press_model=Quasistatic() if self.quasistatic else Dynamic())

    @property
    def problem(self) -> SearchProblem:
        """The rules of the search."""
        scene = self.scene
        return SearchProblem(
            scene.shape_labels, scene.pose_labels, num_objects=self.num_objects, touch_cost=self.touch_cost
        )


@lru_cache(maxsize=2)
def load_sensor(setting: Setting) -> TactileSensor:
    """The setting's sensor, loaded once a process."""
    import torch

    torch.set_num_threads(1)  # the processes share the cores, and sums keep their order
    return TactileSensor.load(setting.sensor, setting.scene)


def make_world(setting: Setting, sensor: TactileSensor, seed: tuple[int, ...]) -> TouchWorld:
    """The objects of the episode with this seed."""
    rng = np.random.default_rng([*seed, _WORLD])
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
    chosen = make_decider(decider, sensor.model.outcome_table())
    started = time.perf_counter()
    episodes = search_lockstep(
        worlds, chosen, setting.problem, [target] * len(worlds), sensor.model, seeds, sensor.touch_many
    )
    total = time.perf_counter() - started
    touches = sum(episode.num_touches for episode in episodes)
    thinking = total - sensor.time.physics - sensor.time.network
    return episodes, Seconds(sensor.time.physics, sensor.time.network, thinking, touches)
