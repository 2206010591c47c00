"""Setting of a comparison, and live episodes in it; the seed alone determines the objects of an episode."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import tyro

from activetouch import Scene, TactileSensor, TouchWorld
from activetouch.errors import AlikeShapes
from activetouch.mesh_source import MeshSource
from activetouch.perception.card import read_card
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.sensor_files import (
    ANY_OBJECT_FILE,
    POLICIES,
    load_observation_model,
    observation_file,
    reader_file,
)
from activetouch.world import TouchTime, touch_many
from belief import Composition, SearchProblem, Touch
from belief.errors import CorruptFile
from belief.observation_model import ArrayModel, ObservationModel, OutcomeTable
from belief.observation_model.rigid_body import joint_model
from belief.seeding import arrangement_rng
from belief.synthetic import sample_arrangement
from experiments.command_line.arguments import BadArgument, Count, NotNegative, Within, check_arguments, require_types
from experiments.command_line.trust import Trust
from experiments.parallel import run_tasks
from experiments.scene_choice import SceneChoice
from experiments.search.run_folder import Seconds
from experiments.search.touch_memo import TouchMemo
from experiments.sensor_choice import check_sensor, load_quietly, sensor_folder
from planners import Decider, Episode, make_decider, search_lockstep
from planners.abstaining import Abstaining
from planners.search import TouchRequest


@dataclass(frozen=True)
class Setting:
    """Setting of all episodes of a run."""

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The scene."""
    sensor: Path | None = None
    """Folder of a reader and an observation model, or name of a scene with a shipped sensor; the shipped sensor of
    the scene by default."""
    num_objects: Count | None = None
    """Number of objects in a search; that of the scene by default."""
    composition: Literal["distinct", "independent"] | None = None
    """distinct: all objects have different shapes. independent: each object can have any shape. That of the scene by
    default."""
    observation_model: Literal["independent"] | None = None
    """independent: the model of the sensor that takes touches of an object as independent given its shape. The
    sensor's own model by default: about one rigid body, if it is a joint one."""
    touch_cost: NotNegative = 0.02
    """Cost λ of one touch, in units of a success."""
    abstain: Annotated[float, Within(0.0, 1.0, open_low=True, open_high=True)] | None = None
    """False-alarm rate of the conflict test, such as 0.02. Every decider then answers "I do not know" (UNSURE) if the
    touches do not fit the world that the sensor knows, or if it would answer with a stated confidence below
    --promise. No decider does by default."""
    promise: Annotated[float, Within(0.0, 1.0)] = 0.95
    """With --abstain: smallest stated confidence of an answer."""
    unsure_reward: Annotated[float, Within(-1.0, 1.0, open_high=True)] = 0.0
    """With --abstain: reward of the answer "I do not know", between a wrong answer (-1) and a success (+1)."""
    anyway: bool = False
    """Accept a sensor that was made for another scene; the report lists the differences."""

    def to_dict(self) -> dict[str, Any]:
        """The setting as plain values."""
        sensor = None if self.sensor is None else str(self.sensor)
        own = {field.name: getattr(self, field.name) for field in fields(Setting)}
        return {**own, "choice": self.choice.to_dict(), "sensor": sensor}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any], trust: Trust) -> Setting:
        """The setting from :meth:`to_dict`, in a file.

        Raises:
            FileNamesCode: the scene or its renderer is code that may not be used.
            CorruptFile: a field is missing or of a wrong type.
            BadArgument: a value is out of its range.
        """
        try:
            sensor = None if fields["sensor"] is None else Path(fields["sensor"])
            found = cls(**{**fields, "choice": SceneChoice.from_dict(fields["choice"], trust), "sensor": sensor})
            require_types(found)
        except (TypeError, KeyError, AttributeError, BadArgument) as error:
            raise CorruptFile(f"{trust.source} does not describe a search: {error}") from error
        check_arguments(found)
        return found

    def resolved(self) -> Setting:
        """The same setting with absolute paths, for workers with another working folder."""
        meshes = tuple(Path(str(MeshSource.parse(mesh).resolved())) for mesh in self.choice.meshes)
        sensor = None if self.sensor is None else self.sensor_folder.resolve()
        return replace(self, choice=replace(self.choice, meshes=meshes), sensor=sensor)

    def player(self, name: str) -> Decider | str:
        """The decider with this name in the report, or its name on the command line."""
        return name

    @property
    def scene(self) -> Scene:
        """The scene of the episodes."""
        return self.choice.named.scene

    @property
    def sensor_folder(self) -> Path:
        """Folder of the reader and the observation model."""
        return sensor_folder(self.sensor, self.choice.scene)

    @property
    def observation_file(self) -> Path:
        """File of the observation model."""
        return observation_file(self.sensor_folder, self.is_independent)

    @property
    def sensor_files(self) -> list[Path]:
        """The files that determine what is read: of a reader of any object, that alone."""
        reader = self.reader_file
        return [reader] if reader.name == ANY_OBJECT_FILE else [reader, self.observation_file]

    @property
    def reader_file(self) -> Path:
        """File of the reader."""
        return reader_file(self.sensor_folder, self.scene, self.is_independent)

    @property
    def is_independent(self) -> bool:
        """Whether the model that takes touches as independent was asked for."""
        return self.observation_model == "independent"

    @property
    def shift(self) -> tuple[str, ...]:
        """Differences between the scene and that of the sensor (:func:`experiments.sensor_choice.check_sensor`)."""
        return check_sensor(self.sensor_folder, self.choice, self.anyway, self.is_independent)

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
            touch_limit=named.touches_per_object * num_objects,
            unsure_reward=None if self.abstain is None else self.unsure_reward,
        )


def require_abstain(setting: Setting) -> None:
    """Raise BadArgument if --promise or --unsure-reward is given without --abstain, where it would do nothing."""
    given = [name for name in ("promise", "unsure_reward") if getattr(setting, name) != getattr(Setting, name)]
    if setting.abstain is None and given:
        name, value = given[0], getattr(setting, given[0])
        raise BadArgument(f"--{name.replace('_', '-')} does nothing without --abstain, got {value}; add --abstain 0.02")


Stamps: TypeAlias = tuple[tuple[int, int] | None, ...]
"""Modification time and size of files, part of cache keys; None for a missing file."""


def stamps(setting: Setting) -> Stamps:
    """Stamps of the files of the setting's sensor."""
    found: list[tuple[int, int] | None] = []
    for path in setting.sensor_files:
        try:
            status = path.stat()
            found.append((status.st_mtime_ns, status.st_size))
        except OSError:
            found.append(None)
    return tuple(found)


def load_sensor(setting: Setting) -> TactileSensor:
    """The setting's sensor, cached per process until its files change."""
    return _load_sensor(setting, stamps(setting))


@lru_cache(maxsize=2)
def _load_sensor(setting: Setting, when: Stamps) -> TactileSensor:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AlikeShapes)  # which every worker would print
        return load_quietly(setting.sensor_folder, setting.scene, setting.anyway, setting.is_independent)


def known_model(setting: Setting) -> tuple[ObservationModel, OutcomeTable]:
    """The sensor's observation model and its outcome table; loads the network only if it reads any object."""
    return _known_model(setting, stamps(setting))


@lru_cache(maxsize=2)
def _known_model(setting: Setting, when: Stamps) -> tuple[ObservationModel, OutcomeTable]:
    folder, independent = setting.sensor_folder, setting.is_independent
    if read_card(setting.reader_file).imaging is not None:
        model: ArrayModel = _load_sensor(setting, when).model
    else:
        model = load_observation_model(folder, independent)
    return model, model.outcome_table()


def prepare(setting: Setting, jobs: int | None) -> None:
    """Compute what a reader of any object needs once, before several processes do; then it is in the cache."""
    if read_card(setting.reader_file).imaging is None:
        return
    load_quietly(setting.sensor_folder, setting.scene, setting.anyway)  # warns of shapes that are alike
    if joint_model(load_sensor(setting).model) is None:
        return
    tasks = [partial(_embed, setting, pose) for pose in range(len(setting.scene.poses))]
    for _ in run_tasks(tasks, jobs, "predicting contacts"):
        pass


def _embed(setting: Setting, pose: int) -> None:
    sensor = load_sensor(setting)
    if (model := joint_model(sensor.model)) is not None:
        HypothesisTable(sensor.reader, setting.scene)(model.num_hypotheses, (pose,))


def build_decider(setting: Setting, name: str) -> Decider:
    """Make the decider with this name, with the setting's observation model and policies; it abstains if asked to."""
    decider = _build(setting, setting.player(name))
    return decider if setting.abstain is None else Abstaining(decider, setting.abstain, setting.promise)


def _build(setting: Setting, player: Decider | str) -> Decider:
    if not isinstance(player, str):
        return deepcopy(player)  # its state must not pass from one shard to another
    model, table = known_model(setting)
    return make_decider(player, table, model, setting.sensor_folder / POLICIES)


def make_world(setting: Setting, sensor: TactileSensor, seed: tuple[int, ...]) -> TouchWorld:
    """The world of the episode with this seed."""
    rng = arrangement_rng(seed)
    return TouchWorld.sample(sensor, sample_arrangement(setting.problem, rng), rng)


def episode_seed(seed: int, target: int, number: int) -> tuple[int, ...]:
    """Seed of one episode of a run."""
    return (seed, target, number)


def play_episodes(
    setting: Setting, decider: str, target: int, seed: int, numbers: Sequence[int], memo: TouchMemo | None = None
) -> tuple[list[Episode], Seconds]:
    """Play episodes in lockstep; the same arguments give the same episodes, bit for bit, in any process.

    Args:
        setting: setting of the run.
        decider: name of the decider.
        target: index of the target shape.
        seed: seed of the run.
        numbers: numbers of the episodes.
        memo: images of touches in this setting, which other deciders of the same episodes made.

    Returns:
        The episodes, and the time that they took together. The time of a press counts for every decider that makes the
        touch, though it is pressed once.
    """
    sensor, spent = load_sensor(setting), [TouchTime()]
    memo = TouchMemo() if memo is None else memo
    seeds = [episode_seed(seed, target, number) for number in numbers]
    worlds = [make_world(setting, sensor, key) for key in seeds]
    chosen = build_decider(setting, decider)

    waited = 0.0

    def touch_and_time(requests: Sequence[TouchRequest[TouchWorld]]) -> list[Touch]:
        nonlocal waited
        asked = time.perf_counter()
        touches, seconds = touch_many(sensor, requests, memo.press)
        spent.append(seconds)
        waited += time.perf_counter() - asked
        return touches

    started = time.perf_counter()
    episodes = search_lockstep(
        worlds, chosen, setting.problem, [target] * len(worlds), sensor.model, seeds, touch_and_time
    )
    thinking = time.perf_counter() - started - waited
    touches = sum(episode.num_touches for episode in episodes)
    seconds = sum(spent, TouchTime())
    return episodes, Seconds(seconds.physics, seconds.network, thinking, touches, seconds.pressed_again)
