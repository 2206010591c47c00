"""What determines searches in trays, and the file of those that were played."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeAlias

from activetouch.tray.sensor import TraySensor
from activetouch.tray.world import Tray
from belief.codec import from_fields, to_fields
from belief.errors import CorruptFile, InvalidArgument
from belief.files import write_text
from belief.references import BadReference, Reference, build
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.search.play import Setting
from planners.tray import TrayRules
from planners.tray_session import TrayEpisode

Key: TypeAlias = tuple[str, str, int]
"""Decider, target and number of a search."""


@dataclass(frozen=True)
class Searches:
    """What determines a search in a tray, apart from decider, target and number: one record of command and function.

    Attributes:
        sensor: scene whose pad comes down on the tray, with its reader of any object.
        shapes: folder of meshes, or mesh files; None for the twelve shapes of ``many``.
        strangers: the same of objects of none of these shapes.
        tray: and what lies in it.
        rules: when to stop, and what travel costs.
        seed: of all searches.
    """

    sensor: str = "gel"
    shapes: Any = None
    strangers: Any = ()
    tray: Tray = field(default_factory=Tray)
    rules: TrayRules = field(default_factory=TrayRules)
    seed: int = 0

    @classmethod
    def of(cls, setting: Setting, seed: int = 0) -> Searches:
        """Those of a scene ``drawer(setting=value, ...)``, whose settings are those of tray and rules.

        Raises:
            BadArgument: the setting has what trays do not know.
            BadReference: the scene has no such setting.
        """
        choice, number = setting.choice, setting.num_objects
        plain = replace(setting, choice=replace(choice, scene=SceneChoice.scene, meshes=(), only=False))
        if replace(plain, sensor=None, num_objects=None) != Setting() or len(choice.meshes) > 1:
            raise BadArgument(
                "the scene drawer takes the pad of --sensor gel, coarse or hard, --meshes FOLDER, a number of objects, "
                f"and settings of its own, as in 'drawer(size=(0.3, 0.2), present=0.5)'; got {setting}"
            )
        given = dict(Reference.parse(choice.scene).settings) | ({} if number is None else {"num_objects": number})
        known = {field.name: kind for kind in (Tray, TrayRules) for field in fields(kind)}
        if unknown := given.keys() - known:
            raise BadReference(f"the scene drawer has no setting {min(unknown)!r}; it has {', '.join(known)}")
        tray, rules = ({n: value for n, value in given.items() if known[n] is kind} for kind in (Tray, TrayRules))
        shapes = choice.meshes[0] if choice.meshes else None
        made = build("drawer", Tray, tray, {}), build("drawer", TrayRules, rules, {})
        return cls(str(setting.sensor or cls.sensor), shapes, (), *made, seed)

    def made(self) -> TraySensor:
        """The sensor; the same one at the next call."""
        if self.key not in _MADE:
            _MADE.clear()  # which are large
            _MADE[self.key] = TraySensor.shipped(self.sensor, self.shapes, self.tray, self.rules, self.strangers)
        return _MADE[self.key]

    @property
    def key(self) -> str:
        """What a file of episodes says of it."""
        given = asdict(replace(self, shapes=_listed(self.shapes), strangers=_listed(self.strangers)))
        return json.dumps(given, sort_keys=True)


def _listed(shapes: Any) -> Any:
    """Shapes as a file of episodes names them."""
    if isinstance(shapes, Mapping):
        return {label: str(solid) for label, solid in shapes.items()}
    if isinstance(shapes, list | tuple):
        return [str(one) for one in shapes]
    return None if shapes is None else str(shapes)


_MADE: dict[str, TraySensor] = {}


def write_searches(path: Path, searches: Searches, kept: Mapping[Key, TrayEpisode]) -> None:
    """Write searches to a file, atomically."""
    lines = [json.dumps({"searches": searches.key})]
    for key in sorted(kept):
        episode = to_fields(kept[key])
        lines.append(json.dumps({"decider": key[0], "number": key[2], **episode}))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, "\n".join(lines) + "\n")


def read_searches(path: Path, searches: Searches) -> dict[Key, TrayEpisode]:
    """The finished searches of a file; none if there is no file."""
    if not path.exists():
        return {}
    found: dict[Key, TrayEpisode] = {}
    try:
        head, *lines = path.read_text(encoding="utf-8").splitlines()
        if json.loads(head)["searches"] != searches.key:
            raise InvalidArgument(f"{path} holds searches with other settings: choose another folder, or delete it")
        for line in lines:
            read = json.loads(line)
            decider, number = read.pop("decider"), read.pop("number")
            episode = from_fields(TrayEpisode, read)
            found[str(decider), episode.target, int(number)] = episode
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, InvalidArgument):
            raise
        raise CorruptFile(f"{path} does not hold searches in trays: {error}") from error
    return found
