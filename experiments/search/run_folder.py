"""A run's folder: what was run (``run.json``), and its episodes in shards that survive a killed run.

run.json            what decides an episode (seed, setting, sensor, versions), the latest arguments, who plays now
shards/*.jsonl      one line an episode, 25 of them or as many as were asked for, written whole or not at all
shards/*.seal.json  what played the shard, a digest of its lines, and seconds by part (episodes are reproducible,
                    seconds are not)
shards/oracle-*    whether full information solves the episodes; shards like all others
shards/bound-*      the upper bound on the return for the discretised sensor model, a single line
episodes.jsonl      all episodes there are of those who play now, in a fixed order

What a shard holds follows from the run's identity, its key, how many episodes it has, and what played it (decision
0033). So it does not matter who writes one, how often, or in which order: several machines may fill one folder at once,
or folders of their own that :mod:`experiments.search.merge` unites. A shard that is not whole, as a copy that broke off
leaves it, or whose lines are not those that were written, counts as missing.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import quote, unquote

from activetouch.named_scenes import SCENES
from belief.errors import ActiveTouchError, CorruptFile
from belief.files import atomic_path, sealed_json, unsealed_json, write_text
from experiments.sensor_choice import command
from planners import Episode

_PACKAGES = ("activetouch", "mujoco-core", "numpy", "scipy", "torch", "transformers")  # what a touch depends on
_CODE = ("activetouch", "belief", "planners")  # what every episode runs


class RunMismatch(ActiveTouchError, ValueError):
    """A folder holds another run than the one that was asked for."""


EPISODES_PER_SHARD = 25
"""Fixed, because the network's last bits depend on what is read together."""

ORACLE, BOUND = "oracle", "bound"
"""Stand for deciders in the keys of shards that say what full information solves, and what planners can expect."""


@dataclass(frozen=True)
class ShardKey:
    """Which episodes a shard holds: the ``number``-th lot of one decider (or the oracle, or the bound) and target."""

    decider: str
    target: str
    number: int

    @property
    def stem(self) -> str:
        """File name without its ending: another one for every key, of characters that every file system takes.

        >>> ShardKey("mine:TwoLooks(touches=4)", "cone", 0).stem
        'mine%3ATwoLooks%28touches%3D4%29-cone-00000'
        """
        return f"{_in_file_name(self.decider)}-{_in_file_name(self.target, '-')}-{self.number:05d}"

    @classmethod
    def from_stem(cls, stem: str) -> ShardKey | None:
        """The key from its file name; None if it is not the name of a shard."""
        found = re.fullmatch(r"([^-]+)-(.+)-(\d{5,})", stem)
        key = None if found is None else cls(unquote(found[1]), unquote(found[2]), int(found[3]))
        return key if key is not None and key.stem == stem else None

    @property
    def is_played(self) -> bool:
        """Whether it holds searches of a decider."""
        return self.decider not in (ORACLE, BOUND)

    @property
    def most(self) -> int:
        """Lines of a full shard."""
        return 1 if self.decider == BOUND else EPISODES_PER_SHARD

    def episodes(self, size: int) -> range:
        """Numbers of its episodes, if it holds so many."""
        first = self.number * EPISODES_PER_SHARD
        return range(first, first + size)


@dataclass(frozen=True)
class Seconds:
    """Time a set of episodes took, by part, the touches it bought, and presses made again as they did not settle."""

    physics: float = 0.0
    network: float = 0.0
    decision: float = 0.0
    num_touches: int = 0
    pressed_again: int = 0

    def __add__(self, other: Seconds) -> Seconds:
        """Time of both sets together."""
        return Seconds(
            self.physics + other.physics,
            self.network + other.network,
            self.decision + other.decision,
            self.num_touches + other.num_touches,
            self.pressed_again + other.pressed_again,
        )

    def ms_per_touch(self) -> dict[str, float]:
        """Milliseconds by part; zero without touches."""
        per = 1e3 / self.num_touches if self.num_touches else 0.0
        return {"physics": self.physics * per, "network": self.network * per, "decision": self.decision * per}


@dataclass(frozen=True)
class Shard:
    """A shard as it is on disk, whole.

    Attributes:
        lines: the episodes, a line of JSON each.
        seconds: they took.
        made_by: digest of what played them (:mod:`experiments.search.fingerprint`).
    """

    lines: Sequence[str]
    seconds: Seconds
    made_by: str


MadeBy: TypeAlias = Mapping[str, Mapping[str, str]]
"""Digest of who plays now, by decider (or oracle, or bound) and target."""


class RunFolder:
    """Reads and writes one run's folder.

    Args:
        path: the folder; made when first written to.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def require(self, identity: Mapping[str, Any]) -> dict[str, Any] | None:
        """What ``run.json`` says, once it is sure that a run may go on here; None if there is none. Writes nothing.

        Args:
            identity: everything that all episodes follow from; versions of what computes them are added.

        Raises:
            RunMismatch: the folder holds a run with another identity.
            CorruptFile: its ``run.json`` is damaged or foreign.
        """
        if not (self.path / "run.json").exists():
            return None
        earlier, wanted = self.read_run(), _with_versions(identity)
        found = earlier["identity"]
        if found != wanted:
            differing = sorted(key for key in {*found, *wanted} if found.get(key) != wanted.get(key))
            raise RunMismatch(
                f"{self.path} holds a run with other {', '.join(differing)}. Choose another --out, or delete it."
            )
        return earlier

    def open(
        self, identity: Mapping[str, Any], arguments: Mapping[str, Any], made_by: MadeBy | None = None
    ) -> str | None:
        """Start a run, or go on with the one that is there.

        Args:
            identity: everything that all episodes follow from; versions of what computes them are added.
            arguments: the rest of what was asked for, recorded only.
            made_by: who plays now, of those that were asked for; what is known of others is kept.

        Returns:
            A warning where earlier episodes were played by other code; None otherwise.

        Raises:
            RunMismatch: the folder holds a run with another identity.
            CorruptFile: its ``run.json`` is damaged or foreign.
            CannotWrite: it is a file, there is no room, or no permission.
        """
        earlier, commit, code, warning = self.require(identity), _commit(), code_digests(), None
        if earlier is not None:
            other = [name for name, digest in code.items() if earlier["code"].get(name) != digest]
            if other:
                warning = (
                    f"{self.path} has episodes of other code of {', '.join(other)} (commit {earlier['commit'] or '?'}, "
                    f"this is {commit or '?'}); they are kept"
                )
            elif earlier["commit"] != commit:
                warning = f"{self.path} has episodes of commit {earlier['commit']}, this is {commit}; they are kept"
        told = united(made_by or {}, {} if earlier is None else earlier["made_by"])
        run = {"identity": _with_versions(identity), "arguments": dict(arguments), "made_by": told}
        self.write_run({**run, "commit": commit, "code": code})
        return warning

    def again(self, **changes: object) -> str:
        """The command that repeats this run, and plays what is missing.

        Args:
            changes: arguments that are to differ, such as ``episodes=1000``.
        """
        if not (self.path / "run.json").exists():
            return _compare_into(self.path)
        return command("compare", config=self.path / "run.json", **changes)

    def write_run(self, run: Mapping[str, Any]) -> None:
        """Write ``run.json``."""
        write_text(self.path / "run.json", sealed_json(run) + "\n")

    def read_run(self) -> dict[str, Any]:
        """What ``run.json`` says.

        Raises:
            FileNotFoundError: there is none.
            CorruptFile: it is damaged or foreign.
        """
        file = self.path / "run.json"
        if not file.exists():
            raise FileNotFoundError(f"{self.path} holds no run; make one with:\n{self.again()}")
        try:
            run = unsealed_json(file.read_text(encoding="utf-8"))
            if run.keys() >= {"identity", "arguments", "made_by", "commit", "code"}:
                return run
            problem = f"it has {', '.join(run) or 'nothing'}"
        except ValueError as error:
            problem = str(error)
        raise CorruptFile(
            f"{file} does not say what was run: {problem}. Choose another --out; or delete that file, if you are sure "
            "that the episodes beside it are of the run that you ask for"
        )

    def read(self, key: ShardKey) -> Shard | None:
        """A shard; None if it is not there, torn, or not as it was written."""
        file = self._shard(key)
        try:
            seal = unsealed_json(self._seal(key).read_text(encoding="utf-8"))
            content = file.read_bytes()
            if seal["lines_sha256"] != hashlib.sha256(content).hexdigest():
                return None
            lines = content.decode("utf-8").splitlines(keepends=True)
            return Shard(lines, Seconds(**seal["seconds"]), seal["made_by"]) if 0 < len(lines) <= key.most else None
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def has(self, key: ShardKey, made_by: str | None = None, size: int | None = None) -> bool:
        """Whether a shard is there: played by this, if that is given, and with so many episodes; else a full one."""
        shard = self.read(key)
        if shard is None or (made_by is not None and shard.made_by != made_by):
            return False
        return len(shard.lines) >= (key.most if size is None else size)

    def complete_keys(self) -> list[ShardKey]:
        """All whole shards, full or partly filled, of those who play now; in the order of their names."""
        try:
            made_by: MadeBy = self.read_run()["made_by"]
        except FileNotFoundError:
            made_by = {}
        stems = sorted(path.stem for path in (self.path / "shards").glob("[!.]*.jsonl"))
        keys = [key for key in map(ShardKey.from_stem, stems) if key is not None]
        shards = [(key, self.read(key)) for key in keys]
        return [
            key
            for key, shard in shards
            if shard is not None and made_by.get(key.decider, {}).get(key.target, shard.made_by) == shard.made_by
        ]

    def write(self, key: ShardKey, shard: Shard) -> None:
        """Write a finished shard; the episodes last.

        Raises:
            CannotWrite: there is no room, or no permission; what was there before still is.
        """
        content = "".join(shard.lines)
        seal = {
            "made_by": shard.made_by,
            "lines_sha256": hashlib.sha256(content.encode("utf-8")).hexdigest(),
            "seconds": asdict(shard.seconds),
        }
        write_text(self._seal(key), sealed_json(seal, indent=None) + "\n")
        write_text(self._shard(key), content)

    def write_episodes(self, lines: Iterable[str]) -> None:
        """Write ``episodes.jsonl``."""
        with atomic_path(self.path / "episodes.jsonl") as temporary, temporary.open("w") as file:
            file.writelines(lines)

    def lines(self, key: ShardKey) -> Sequence[str]:
        """The episodes of a shard, a line of JSON each.

        Raises:
            FileNotFoundError: it is not there, or not whole.
        """
        shard = self.read(key)
        if shard is None:
            raise FileNotFoundError(
                f"{self._shard(key)} is not there, or not as it was written; play it with:\n{self.again()}"
            )
        return shard.lines

    def _shard(self, key: ShardKey) -> Path:
        return self.path / "shards" / f"{key.stem}.jsonl"

    def _seal(self, key: ShardKey) -> Path:
        return self.path / "shards" / f"{key.stem}.seal.json"


def _compare_into(folder: Path) -> str:
    """The command that fills a folder; the name of the folder tells the scene where it is a default one."""
    scene = folder.name.removeprefix("compare-")
    return command("compare", scene=scene if scene in SCENES else None, out=folder)


def _in_file_name(text: str, keep: str = "") -> str:
    """A text in letters, digits, "_" and what is to be kept; all else by its number, as in an address."""
    return re.sub(rf"[^%\w{keep}]", lambda found: f"%{ord(found[0]):02X}", quote(text, safe=""), flags=re.ASCII)


def united(first: MadeBy, second: MadeBy) -> dict[str, dict[str, str]]:
    """Who plays now, after two lists; what the first says of one counts.

    The order is that of the first if it names all; else that of the second, and what is new comes last.

    >>> united({"b": {"x": "1"}}, {"a": {"x": "2"}, "b": {"x": "3", "y": "4"}})
    {'a': {'x': '2'}, 'b': {'x': '1', 'y': '4'}}
    >>> list(united({"b": {}, "a": {}}, {"a": {}}))
    ['b', 'a']
    """

    def order(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
        return list(one) if one.keys() >= other.keys() else list(dict.fromkeys([*other, *one]))

    return {
        name: {
            target: first.get(name, {}).get(target) or second[name][target]
            for target in order(first.get(name, {}), second.get(name, {}))
        }
        for name in order(first, second)
    }


def episode_lines(decider: str, episodes: Iterable[Episode]) -> list[str]:
    """A line of JSON for every episode."""
    return [json.dumps({"decider": decider, **episode.to_dict()}) + "\n" for episode in episodes]


def read_episode(line: str, shape_labels: tuple[str, ...]) -> Episode:
    """An episode from its line of JSON."""
    return Episode.from_dict(json.loads(line), shape_labels)


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions of all that a touch depends on."""
    return {"python": platform.python_version()} | {name: importlib.metadata.version(name) for name in _PACKAGES}


def _with_versions(identity: Mapping[str, Any]) -> Any:
    return json.loads(json.dumps({**identity, "versions": versions()}))


@lru_cache(maxsize=1)
def code_digests() -> dict[str, str]:
    """Digest of the text of each package that all episodes run, as this process first saw it."""
    root = Path(__file__).parents[2]
    found = {}
    for name in _CODE:
        digest = hashlib.sha256()
        for file in sorted((root / name).rglob("*.py")):
            digest.update(str(file.relative_to(root)).encode() + file.read_bytes())
        found[name] = digest.hexdigest()
    return found


def _commit() -> str:
    """Commit of the checkout this code runs from, marked if it has changes; empty outside a checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
