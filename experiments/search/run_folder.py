"""Run folder of a comparison: ``run.json``, and the episodes in shards that survive an interruption.

run.json            identity of the run (seed, setting, sensor, versions), latest arguments, digests of the deciders
shards/*.jsonl      25 episodes or fewer, one JSON line each; written atomically
shards/*.seal.json  digests of the run's identity, of the decider and of the lines, and seconds by part
shards/oracle-*     whether the full-information oracle solves the episodes
shards/bound-*      upper bound on the return for the discretised sensor model, one line
episodes.jsonl      all episodes of the current deciders, in a fixed order

Run identity, shard key, number of episodes and decider determine the content of a shard, so several machines can fill
one folder at once (decisions 0028 and 0033). The identity in run.json never changes; of several processes that start
different runs in one folder, the first to finish a shard gets it. A shard that is damaged, incomplete or of another run
counts as missing.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote

from activetouch.named_scenes import SCENES
from belief.errors import ActiveTouchError, CorruptFile
from belief.files import (
    atomic_path,
    create_text,
    in_file_name,
    require_regular_file,
    sealed_json,
    unsealed_json,
    write_text,
)
from experiments.search.fingerprint import code_digests, commit_of_code, differing, versions
from experiments.sensor_commands import command
from planners import Episode

_FORMAT = 2  # in format 1, seals of shards did not name the run


_FIELDS = {"identity": dict, "arguments": dict, "made_by": dict, "commit": str, "code": dict, "format": int}


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
        return f"{in_file_name(self.decider)}-{in_file_name(self.target, '-')}-{self.number:05d}"

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
        self._known: tuple[str, int] | None = None

    def require(self, identity: Mapping[str, Any]) -> dict[str, Any] | None:
        """Check that the folder holds this run or none; return the content of ``run.json``, None without one.

        Args:
            identity: what determines all episodes; versions of packages are added.

        Raises:
            RunMismatch: The folder holds a run with another identity.
            CorruptFile: ``run.json`` is damaged or not that of a run.
        """
        wanted = _with_versions(identity)
        earlier = self._read_same(wanted) if (self.path / "run.json").exists() else None
        self._known = _digest(wanted), _FORMAT if earlier is None else earlier["format"]
        return earlier

    def _read_same(self, identity: Mapping[str, Any]) -> dict[str, Any]:
        """The content of ``run.json``; raises RunMismatch unless it has this identity."""
        run = self.read_run()
        if run["identity"] != identity:
            raise RunMismatch(
                f"{self.path} holds a run with other {differing(run['identity'], identity)}. Give this run a folder of "
                f"its own: --out {self.path}-2"
            )
        return run

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
        commit, code, warning = commit_of_code(), code_digests(), None
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
        self.write_run({**run, "commit": commit, "code": code, "format": (earlier or {}).get("format", _FORMAT)})
        return warning

    def again(self, **changes: object) -> str:
        """The command that continues this run, with changed arguments such as ``episodes=1000``."""
        if not (self.path / "run.json").exists():
            scene = self.path.name.removeprefix("compare-")  # as in the name of a default folder
            return command("compare", scene=scene if scene in SCENES else None, out=self.path)
        return command("compare", config=self.path / "run.json", **changes)

    def write_run(self, run: Mapping[str, Any]) -> None:
        """Write ``run.json``; another process may have written that of another run since it was read.

        Raises:
            RunMismatch: The folder holds a run with another identity.
        """
        file, text = self.path / "run.json", sealed_json(run) + "\n"
        if not create_text(file, text):
            self._read_same(run["identity"])
            write_text(file, text)
        self._known = _digest(run["identity"]), run["format"]

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
            run = {"format": 1, **unsealed_json(require_regular_file(file).read_text(encoding="utf-8"))}
            wrong = [name for name, kind in _FIELDS.items() if not isinstance(run.get(name), kind)]
            problem = f"these fields are missing or of a wrong type: {', '.join(wrong)}"
            if not wrong and run["format"] in range(1, _FORMAT + 1):
                return run
            if not wrong:
                problem = f"its format is {run['format']}, and this version reads 1 to {_FORMAT}"
        except ValueError as error:
            problem = str(error)
        raise CorruptFile(
            f"{file} does not describe a run: {problem}. Choose another --out; or delete this file and repeat the "
            "command of the run, which keeps the episodes that belong to it"
        )

    def read(self, key: ShardKey) -> Shard | None:
        """Read a shard; None if it is missing, incomplete, changed or of another run."""
        try:
            seal, content = self._read_seal(key), require_regular_file(self._shard(key)).read_bytes()
            if not self._owns(seal) or seal["lines_sha256"] != hashlib.sha256(content).hexdigest():
                return None
            lines = content.decode("utf-8").splitlines(keepends=True)
            return Shard(lines, Seconds(**seal["seconds"]), seal["made_by"]) if 0 < len(lines) <= key.most else None
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def _read_seal(self, key: ShardKey) -> dict[str, Any]:
        """The fields of a seal; none if it is missing or damaged."""
        try:
            return unsealed_json(require_regular_file(self._seal(key)).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}

    def _run(self) -> tuple[str, int]:
        """Digest of the identity of the run that this process plays or reads, and the format of its folder."""
        if self._known is None:
            run = self.read_run()
            self._known = _digest(run["identity"]), run["format"]
        return self._known

    def _owns(self, seal: Mapping[str, Any]) -> bool:
        """Whether a seal names this run; in format 1 none names any."""
        digest, version = self._run()
        return bool(seal.get("run", digest if version == 1 else None) == digest)

    def tell_foreign(self) -> None:
        """Print to stderr which shards are left out of all results because their seal names another run, or none."""
        stems = [key.stem for key in self._keys() if (seal := self._read_seal(key)) and not self._owns(seal)]
        if stems:
            some = ", ".join(stems[:5]) + (f" and {len(stems) - 5} more" if len(stems) > 5 else "")
            print(f"{self.path} has shards of another run; they are left out: {some}", file=sys.stderr)

    def _keys(self) -> list[ShardKey]:
        stems = sorted(path.stem for path in (self.path / "shards").glob("[!.]*.jsonl"))
        return [key for key in map(ShardKey.from_stem, stems) if key is not None]

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
        shards = [(key, self.read(key)) for key in self._keys()]
        return [
            key
            for key, shard in shards
            if shard is not None and made_by.get(key.decider, {}).get(key.target, shard.made_by) == shard.made_by
        ]

    def write(self, key: ShardKey, shard: Shard) -> None:
        """Write a shard, first its seal, then its episodes; the folder must hold a run.

        Raises:
            FileNotFoundError: There is no ``run.json``.
            CannotWrite: The disk is full, or the folder is not writable; an earlier shard is kept.
        """
        content = "".join(shard.lines)
        seal = {
            "run": self._run()[0],
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
            FileNotFoundError: The shard is missing, damaged or of another run.
        """
        shard = self.read(key)
        if shard is None:
            raise FileNotFoundError(
                f"{self._shard(key)} is missing, damaged or of another run; make it with:\n{self.again()}"
            )
        return shard.lines

    def _shard(self, key: ShardKey) -> Path:
        return self.path / "shards" / f"{key.stem}.jsonl"

    def _seal(self, key: ShardKey) -> Path:
        return self.path / "shards" / f"{key.stem}.seal.json"


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


def episode_lines(decider: str, episodes: Iterable[Episode]) -> list[str]:
    """One JSON line per episode."""
    return [json.dumps({"decider": decider, **episode.to_dict()}) + "\n" for episode in episodes]


def read_episode(line: str, shape_labels: tuple[str, ...]) -> Episode:
    """Read an episode from its JSON line."""
    return Episode.from_dict(json.loads(line), shape_labels)


def _with_versions(identity: Mapping[str, Any]) -> Any:
    return json.loads(json.dumps({**identity, "versions": versions()}))


def _digest(identity: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
