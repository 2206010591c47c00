"""Run folder of a comparison: ``run.json``, and the episodes in shards that survive an interruption.

run.json            identity of the run (seed, setting, sensor, versions), latest arguments, digests of the deciders
shards/*.jsonl      25 episodes or fewer, one JSON line each; written atomically
shards/*.seal.json  digest of the decider, digest of the lines, and seconds by part
shards/oracle-*     whether the full-information oracle solves the episodes
shards/bound-*      upper bound on the return for the discretised sensor model, one line
episodes.jsonl      all episodes of the current deciders, in a fixed order

Run identity, shard key, number of episodes and decider determine the content of a shard, so several machines can fill
one folder at once (decisions 0028 and 0033). A shard that is damaged or incomplete counts as missing.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import quote, unquote

from activetouch.named_scenes import SCENES
from belief.errors import ActiveTouchError, CorruptFile
from belief.files import atomic_path, sealed_json, unsealed_json, write_text
from experiments.sensor_choice import command
from planners import Episode

_PACKAGES = ("activetouch", "mujoco-core", "numpy", "scipy", "onnxruntime")  # that a touch depends on
_CODE = ("activetouch", "belief", "planners")  # packages whose code every episode runs


class RunMismatch(ActiveTouchError, ValueError):
    """A folder holds another run than the requested one."""


EPISODES_PER_SHARD = 25
"""Fixed, because the last bits of the network's output depend on which images are read in one batch."""

ORACLE, BOUND = "oracle", "bound"
"""Names in place of a decider, for shards of the full-information oracle and of the upper bound on the return."""


@dataclass(frozen=True)
class ShardKey:
    """Key of a shard: decider (or the oracle, or the bound), target, and number of the shard from 0."""

    decider: str
    target: str
    number: int

    @property
    def stem(self) -> str:
        """File name without its ending: unique, and valid on every file system.

        >>> ShardKey("mine:TwoLooks(touches=4)", "cone", 0).stem
        'mine%3ATwoLooks%28touches%3D4%29-cone-00000'
        """
        return f"{_in_file_name(self.decider)}-{_in_file_name(self.target, '-')}-{self.number:05d}"

    @classmethod
    def from_stem(cls, stem: str) -> ShardKey | None:
        """The key from the file name; None for other files."""
        found = re.fullmatch(r"([^-]+)-(.+)-(\d{5,})", stem)
        key = None if found is None else cls(unquote(found[1]), unquote(found[2]), int(found[3]))
        return key if key is not None and key.stem == stem else None

    @property
    def is_played(self) -> bool:
        """Whether the shard holds searches of a decider."""
        return self.decider not in (ORACLE, BOUND)

    @property
    def most(self) -> int:
        """Number of lines of a full shard."""
        return 1 if self.decider == BOUND else EPISODES_PER_SHARD

    def episodes(self, size: int) -> range:
        """Numbers of the first ``size`` episodes of the shard."""
        first = self.number * EPISODES_PER_SHARD
        return range(first, first + size)


@dataclass(frozen=True)
class Seconds:
    """Seconds that a set of episodes took, by part; its number of touches, and of presses repeated until settled."""

    physics: float = 0.0
    network: float = 0.0
    decision: float = 0.0
    num_touches: int = 0
    pressed_again: int = 0

    def __add__(self, other: Seconds) -> Seconds:
        """Sum of two sets of episodes."""
        return Seconds(*(mine + theirs for mine, theirs in zip(astuple(self), astuple(other), strict=True)))

    def ms_per_touch(self) -> dict[str, float]:
        """Milliseconds per touch by part; zero without touches."""
        per = 1e3 / self.num_touches if self.num_touches else 0.0
        return {"physics": self.physics * per, "network": self.network * per, "decision": self.decision * per}


@dataclass(frozen=True)
class Shard:
    """Content of a shard.

    Attributes:
        lines: one JSON line per episode.
        seconds: time that the episodes took.
        made_by: digest of the decider that played them (:func:`experiments.search.shards.made_by`).
    """

    lines: Sequence[str]
    seconds: Seconds
    made_by: str


MadeBy: TypeAlias = Mapping[str, Mapping[str, str]]
"""Digest of the current version of each decider (or oracle, or bound), by name and target."""


class RunFolder:
    """Reads and writes a run folder.

    Args:
        path: the folder; created by the first write.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def require(self, identity: Mapping[str, Any]) -> dict[str, Any] | None:
        """Check that the folder holds this run or none; return the content of ``run.json``, None without one.

        Args:
            identity: what determines all episodes; versions of packages are added.

        Raises:
            RunMismatch: The folder holds a run with another identity.
            CorruptFile: ``run.json`` is damaged or not that of a run.
        """
        if not (self.path / "run.json").exists():
            return None
        earlier, wanted = self.read_run(), _with_versions(identity)
        found = earlier["identity"]
        if found != wanted:
            raise RunMismatch(
                f"{self.path} holds a run with other {differing(found, wanted)}. Give this run a folder of its own: "
                f"--out {self.path}-2"
            )
        return earlier

    def open(
        self, identity: Mapping[str, Any], arguments: Mapping[str, Any], made_by: MadeBy | None = None
    ) -> str | None:
        """Start or continue a run: write ``run.json``.

        Args:
            identity: what determines all episodes; versions of packages are added.
            arguments: arguments of the command, for the record.
            made_by: digests of the requested deciders; those of others are kept.

        Returns:
            A warning if earlier episodes were played by other code; None otherwise.

        Raises:
            RunMismatch: The folder holds a run with another identity.
            CorruptFile: ``run.json`` is damaged or not that of a run.
            CannotWrite: The disk is full, or the folder is a file or not writable.
        """
        commit, code, warning = _commit(), code_digests(), None
        earlier = self.require(identity)  # read last, so that no other process writes between
        if earlier is not None:
            other = [name for name, digest in code.items() if earlier["code"].get(name) != digest]
            if other or earlier["commit"] != commit:
                changed = f", other code of {', '.join(other)}" if other else ""
                warning = (
                    f"{self.path} keeps earlier episodes (commit {earlier['commit'] or '?'}{changed}; the current "
                    f"commit is {commit or '?'})"
                )
        players = united(made_by or {}, {} if earlier is None else earlier["made_by"])
        run = {"identity": _with_versions(identity), "arguments": dict(arguments), "made_by": players}
        self.write_run({**run, "commit": commit, "code": code})
        return warning

    def again(self, **changes: object) -> str:
        """The command that continues this run, with changed arguments such as ``episodes=1000``."""
        if not (self.path / "run.json").exists():
            scene = self.path.name.removeprefix("compare-")  # as in the name of a default folder
            return command("compare", scene=scene if scene in SCENES else None, out=self.path)
        return command("compare", config=self.path / "run.json", **changes)

    def write_run(self, run: Mapping[str, Any]) -> None:
        """Write ``run.json``."""
        write_text(self.path / "run.json", sealed_json(run) + "\n")

    def read_run(self) -> dict[str, Any]:
        """The content of ``run.json``.

        Raises:
            FileNotFoundError: It does not exist.
            CorruptFile: It is damaged or not that of a run.
        """
        file = self.path / "run.json"
        if not file.exists():
            raise FileNotFoundError(f"{self.path} holds no run; start one with:\n{self.again()}")
        try:
            run = unsealed_json(file.read_text(encoding="utf-8"))
            if run.keys() >= {"identity", "arguments", "made_by", "commit", "code"}:
                return run
            problem = f"it has only {', '.join(run) or 'no fields'}"
        except ValueError as error:
            problem = str(error)
        raise CorruptFile(
            f"{file} does not describe a run: {problem}. Choose another --out; or delete this file, if you are sure "
            "that the folder's episodes belong to the requested run"
        )

    def read(self, key: ShardKey) -> Shard | None:
        """Read a shard; None if it is missing, incomplete or changed."""
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
        """Whether the folder holds a shard.

        Args:
            key: key of the shard.
            made_by: required digest of its decider; any if None.
            size: required number of episodes; a full shard if None.
        """
        shard = self.read(key)
        if shard is None or (made_by is not None and shard.made_by != made_by):
            return False
        return len(shard.lines) >= (key.most if size is None else size)

    def complete_keys(self) -> list[ShardKey]:
        """Keys of all intact shards of the current deciders, in the order of the file names."""
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
        """Write a shard, first its seal, then its episodes.

        Raises:
            CannotWrite: The disk is full, or the folder is not writable; an earlier shard is kept.
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
        """The episodes of a shard, one JSON line each.

        Raises:
            FileNotFoundError: The shard is missing or damaged.
        """
        shard = self.read(key)
        if shard is None:
            raise FileNotFoundError(f"{self._shard(key)} is missing or damaged; make it with:\n{self.again()}")
        return shard.lines

    def _shard(self, key: ShardKey) -> Path:
        return self.path / "shards" / f"{key.stem}.jsonl"

    def _seal(self, key: ShardKey) -> Path:
        return self.path / "shards" / f"{key.stem}.seal.json"


def _in_file_name(text: str, keep: str = "") -> str:
    """Percent-encode all characters except letters, digits, "_" and those in ``keep``."""
    return re.sub(rf"[^%\w{keep}]", lambda found: f"%{ord(found[0]):02X}", quote(text, safe=""), flags=re.ASCII)


def united(first: MadeBy, second: MadeBy) -> dict[str, dict[str, str]]:
    """Union of two tables of digests; entries of the first take precedence.

    The order is that of the first if it has all keys; otherwise that of the second, followed by the new keys.

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


_IN_WORDS = {
    "problem": "objects or costs of a search (--num-objects, --composition, --touch-cost, --abstain)",
    "scene_code_sha256": "code of the scene",
    "sensor_sha256": "sensor",
    "observation_model_code_sha256": "code of the observation model",
}


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """What differs between two identities, in words."""
    keys = sorted(key for key in {*one, *other} if one.get(key) != other.get(key))
    return ", ".join(_IN_WORDS.get(key, key) for key in keys)


def episode_lines(decider: str, episodes: Iterable[Episode]) -> list[str]:
    """One JSON line per episode."""
    return [json.dumps({"decider": decider, **episode.to_dict()}) + "\n" for episode in episodes]


def read_episode(line: str, shape_labels: tuple[str, ...]) -> Episode:
    """Read an episode from its JSON line."""
    return Episode.from_dict(json.loads(line), shape_labels)


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions of Python and of all packages that a touch depends on."""
    return {"python": platform.python_version()} | {name: importlib.metadata.version(name) for name in _PACKAGES}


def _with_versions(identity: Mapping[str, Any]) -> Any:
    return json.loads(json.dumps({**identity, "versions": versions()}))


@lru_cache(maxsize=1)
def code_digests() -> dict[str, str]:
    """SHA-256 of the source text of each package that all episodes run, computed once per process."""
    root = Path(__file__).parents[2]
    found = {}
    for name in _CODE:
        digest = hashlib.sha256()
        for file in sorted((root / name).rglob("*.py")):
            digest.update(str(file.relative_to(root)).encode() + file.read_bytes())
        found[name] = digest.hexdigest()
    return found


def made_with() -> dict[str, str]:
    """Versions of packages and digests of code, on which everything that is computed depends."""
    return versions() | code_digests()


def _commit() -> str:
    """Git commit of this code, marked if there are uncommitted changes; empty outside a Git checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
