"""``activetouch.compare``: the command ``compare`` for deciders, scenes and sensors that a program made."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from activetouch import Scene, TactileSensor
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.scene_description import scene_fields
from activetouch.world import CLASSIFIER_FILE, write_observation_model
from experiments.command_line.arguments import BadArgument
from experiments.parallel import default_jobs
from experiments.scene_choice import SceneChoice, as_named
from experiments.search.compare import Compare
from experiments.search.run_folder import BOUND, ORACLE
from experiments.search.setting import Setting
from experiments.search.summary import Comparison
from planners import Decider

SCENE_OBJECT = "own scene"
"""What reports call a scene that a program made."""


@dataclass(frozen=True)
class SceneObject(SceneChoice):
    """A scene that a program made.

    Attributes:
        given: the scene and its search.
        digest: of both, by which two are told apart.
    """

    scene: str = SCENE_OBJECT
    given: NamedScene = field(default_factory=NamedScene, compare=False)
    digest: str = ""

    @classmethod
    def of(cls, named: NamedScene) -> SceneObject:
        """The choice of this scene."""
        told = [scene_fields(named.scene), named.num_objects, repr(named.composition)]
        return cls(given=named, digest=hashlib.sha256(json.dumps(told).encode()).hexdigest())

    @property
    def named(self) -> NamedScene:
        """The scene and its search."""
        return self.given

    def to_dict(self) -> dict[str, Any]:
        """The choice as plain values, from which the scene cannot be made again."""
        return SceneChoice(self.scene).to_dict()


@dataclass(frozen=True)
class ObjectSetting(Setting):
    """A setting whose deciders are objects of a program, or names.

    Attributes:
        players: decider, or its name as on the command line, by the name that it has in the report.
    """

    players: Mapping[str, Decider | str] = field(default_factory=dict, compare=False)

    def player(self, name: str) -> Decider | str:
        """See :meth:`Setting.player`."""
        return self.players.get(name, name)


def compare(
    scene: str | Scene | NamedScene = "gel",
    deciders: Mapping[str, Decider | str] | Sequence[str] = Compare.deciders,
    *,
    episodes: int = 250,
    seed: int = 0,
    targets: Sequence[str] = (),
    sensor: str | Path | TactileSensor | None = None,
    out: str | Path | None = None,
    reference: str | None = None,
    num_objects: int | None = None,
    touch_cost: float = 0.02,
    anyway: bool = False,
    jobs: int | None = None,
) -> Comparison:
    """Let deciders search live on the same episodes, as the command ``compare`` does, and write its report.

    The numbers are those of the command for the same deciders, scene, sensor and seed. What is finished is kept in the
    folder: the same call goes on after an interruption.

    Args:
        scene: its name, or a scene that you made.
        deciders: names as on the command line; or by the names they are to have in the report, deciders that you made
            or such names. Deciders are pickled and sent to worker processes.
        episodes: searches for each decider and target.
        seed: of the whole comparison.
        targets: shapes to search for; all by default.
        sensor: a sensor, its folder, or the name of a scene that comes with one; the scene's own by default.
        out: folder of the run; that of the command by default.
        reference: the decider that the others are compared with; the first by default.
        num_objects: on the table; as many as the scene has by default.
        touch_cost: λ.
        anyway: whether to use the sensor in a scene that it was not made for.
        jobs: processes; all cores by default.

    Returns:
        All numbers of the report.

    Raises:
        BadArgument: there is nothing to play, or no such search.
        UnknownName: a name that leads to nothing.
        WrongScene: the sensor was made for another scene.
        RunMismatch: the folder holds another run.
    """
    players = dict(deciders) if isinstance(deciders, Mapping) else {name: name for name in deciders}
    for name, player in players.items():
        if name in (ORACLE, BOUND) or not name:
            raise BadArgument(f"a decider cannot be called {name!r}; give it another name")
        if not isinstance(player, str) and not callable(getattr(player, "decide", None)):
            raise BadArgument(f"{name!r} is no decider: it has no method decide(info, rng), got {player!r:.80}")
    choice = _choice(scene)
    request = Compare(
        tuple(players),
        reference=reference,
        targets=tuple(targets),
        episodes=episodes,
        seed=seed,
        setting=ObjectSetting(
            choice, num_objects=num_objects, touch_cost=touch_cost, anyway=anyway, players=MappingProxyType(players)
        ),
        out=None if out is None else Path(out),
        jobs=jobs if jobs is not None else default_jobs(),
    )
    return request.of_sensor(_folder(sensor, request.folder)).report()[0]


def _choice(scene: str | Scene | NamedScene) -> SceneChoice:
    if isinstance(scene, str):
        return SceneChoice(scene)
    for name, named in SCENES.items():
        if scene is named or scene is named.scene:
            return SceneChoice(name)
    if not isinstance(scene, Scene | NamedScene):
        raise BadArgument(f"scene must be a name, a Scene or a NamedScene, got {scene!r:.80}")
    return SceneObject.of(scene if isinstance(scene, NamedScene) else as_named(scene))


def _folder(sensor: str | Path | TactileSensor | None, run: Path) -> Path | None:
    """Where a sensor is; one that a program made is written into the folder of the run."""
    if not isinstance(sensor, TactileSensor):
        return None if sensor is None else Path(sensor)
    folder, card = run / "sensor", sensor.classifier.card
    sensor.classifier.save(folder / CLASSIFIER_FILE)
    write_observation_model(folder, sensor.model, card.scene or scene_fields(sensor.scene))
    return folder
