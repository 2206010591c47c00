"""``activetouch.compare``: the command ``compare`` for decider, scene and sensor objects."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

from activetouch import Scene, TactileSensor
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.scene_description import scene_fields
from activetouch.sensor_files import READER_FILE, observation_file, write_observation_model
from experiments.command_line.arguments import BadArgument
from experiments.parallel import default_jobs
from experiments.scene_choice import SceneChoice, as_named
from experiments.search.compare import Compare
from experiments.search.fingerprint import files_digest
from experiments.search.run_folder import BOUND, ORACLE
from experiments.search.setting import Setting
from experiments.search.summary import Comparison
from planners import Decider

SCENE_OBJECT = "own scene"
"""Name of a scene object in reports."""


@dataclass(frozen=True)
class SceneObject(SceneChoice):
    """A scene object in place of a named scene.

    Attributes:
        given: the scene and its search.
        digest: SHA-256 of both, which distinguishes scene objects.
    """

    scene: str = SCENE_OBJECT
    given: NamedScene = field(default_factory=NamedScene, compare=False)
    digest: str = ""

    @classmethod
    def of(cls, named: NamedScene) -> SceneObject:
        """Wrap a scene and its search."""
        described = [scene_fields(named.scene), named.num_objects, repr(named.composition)]
        return cls(given=named, digest=hashlib.sha256(json.dumps(described).encode()).hexdigest())

    @property
    def named(self) -> NamedScene:
        """The scene and its search."""
        return self.given

    def to_dict(self) -> dict[str, Any]:
        """The choice as plain values; they do not contain the scene."""
        return SceneChoice(self.scene).to_dict()


@dataclass(frozen=True)
class ObjectSetting(Setting):
    """A setting with decider objects.

    Attributes:
        players: decider, or its name on the command line, by its name in the report.
    """

    players: Mapping[str, Decider | str] = field(default_factory=dict, compare=False)

    def player(self, name: str) -> Decider | str:
        """See :meth:`Setting.player`."""
        return self.players.get(name, name)


def compare(
    scene: str | Scene | NamedScene = "gel",
    deciders: Mapping[str, Decider | str] | Sequence[str] | str = Compare.deciders,
    *,
    episodes: int = 250,
    seed: int = 0,
    targets: Sequence[str] | str = (),
    sensor: str | Path | TactileSensor | None = None,
    out: str | Path | None = None,
    reference: str | None = None,
    num_objects: int | None = None,
    touch_cost: float = 0.02,
    abstain: float | None = None,
    promise: float = 0.95,
    unsure_reward: float = 0.0,
    anyway: bool = False,
    jobs: int | None = None,
) -> Comparison:
    """Run live searches with several deciders on identical episodes and write a report, as the command ``compare``.

    The same deciders, scene, sensor and seed give the same numbers as the command. Finished episodes are kept: after an
    interruption, the same call continues.

    Args:
        scene: name of a scene, or a scene object.
        deciders: a name as on the command line or several, or a mapping from names in the report to deciders or names.
            Decider objects are pickled and sent to worker processes.
        episodes: searches per decider and target.
        seed: seed of the whole comparison.
        targets: shapes to search for, or one; all by default.
        sensor: sensor object, folder of a sensor, or name of a scene with a shipped sensor; by default the shipped
            sensor of ``scene``.
        out: folder of the run; the same default as the command.
        reference: decider that the others are compared with; the first by default.
        num_objects: number of objects in a search; that of the scene by default.
        touch_cost: cost λ of one touch, in units of a success.
        abstain: false-alarm rate of the conflict test, with which every decider can answer "I do not know"; not by
            default.
        promise: with ``abstain``, the smallest stated confidence of an answer.
        unsure_reward: with ``abstain``, the reward of "I do not know".
        anyway: whether to accept a sensor that was made for another scene.
        jobs: number of processes; all cores by default.

    Returns:
        All numbers of the report.

    Raises:
        BadArgument: An argument is invalid.
        UnknownName: A name does not exist.
        WrongScene: The sensor was made for another scene.
        RunMismatch: The folder holds another run.
    """
    deciders = (deciders,) if isinstance(deciders, str) else deciders
    targets = (targets,) if isinstance(targets, str) else targets
    players = dict(deciders) if isinstance(deciders, Mapping) else {name: name for name in deciders}
    for name, player in players.items():
        if name in (ORACLE, BOUND) or not name:
            raise BadArgument(f"a decider cannot be called {name!r}; give it another name")
        if not isinstance(player, str) and not callable(getattr(player, "decide", None)):
            raise BadArgument(f"{name!r} is not a decider: it has no method decide(info, rng), got {player!r:.80}")
    request = Compare(
        tuple(players),
        reference=reference,
        targets=tuple(targets),
        episodes=episodes,
        seed=seed,
        setting=ObjectSetting(
            _choice(scene),
            num_objects=num_objects,
            touch_cost=touch_cost,
            abstain=abstain,
            promise=promise,
            unsure_reward=unsure_reward,
            anyway=anyway,
            players=MappingProxyType(players),
        ),
        out=None if out is None else Path(out),
        jobs=jobs if jobs is not None else default_jobs(),
    )
    setting = replace(request.setting, sensor=_sensor_folder(sensor, request.folder))
    return replace(request, setting=setting).report()[0]


def _choice(scene: str | Scene | NamedScene) -> SceneChoice:
    if isinstance(scene, str):
        return SceneChoice(scene)
    for name, named in SCENES.items():
        if scene is named or scene is named.scene:
            return SceneChoice(name)
    if not isinstance(scene, Scene | NamedScene):
        raise BadArgument(f"scene must be a name, a Scene or a NamedScene, got {scene!r:.80}")
    return SceneObject.of(scene if isinstance(scene, NamedScene) else as_named(scene))


def _sensor_folder(sensor: str | Path | TactileSensor | None, run: Path) -> Path | None:
    """Folder of a sensor; a sensor object is written into the folder of the run, under a name of its own."""
    if not isinstance(sensor, TactileSensor):
        return None if sensor is None else Path(sensor)
    here = scene_fields(sensor.scene)
    run.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=".sensor", dir=run) as written:
        new = Path(written) / "sensor"
        sensor.reader.save(new / READER_FILE)
        write_observation_model(new, sensor.model, sensor.reader.card.in_poses_of(here) or here)
        folder = run / f"sensor-{files_digest([new / READER_FILE, observation_file(new)])[:12]}"
        if not folder.exists():
            new.rename(folder)
    return folder
