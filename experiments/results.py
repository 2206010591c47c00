"""A run's folder: what was run (``run.json``), and its episodes in shards that survive a killed run.

run.json            what decides an episode (seed, setting, sensor, versions), the latest arguments, the commit
shards/*.jsonl      one line an episode, 25 of them, written whole or not at all
shards/*.time.json  seconds the shard took, by part (kept apart: episodes are reproducible, seconds are not)
shards/ceiling-*    whether full information solves the episodes; shards like all others
shards/bound-*      the upper bound on the return for the discretised sensor model, a single line
episodes.jsonl      the episodes last asked for, in a fixed order, once all are there

Shards are keyed by what they hold, and what they hold follows from the run's identity. So it does not matter who writes
one, how often, or in which order: several machines may fill one folder at once, or folders of their own that
:mod:`experiments.merge` unites. A shard that is not whole, as a copy that broke off leaves it, counts as missing.
"""

from __future__ import annotations

import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from belief.errors import ActiveTouchError, CannotWrite, CorruptFile
from belief.files import atomic_path, write_text
from planners import Episode

_PACKAGES = ("activetouch", "mujoco-core", "numpy", "scipy", "torch", "transformers")  # what a touch depends on


class RunMismatch(ActiveTouchError, ValueError):
    """A folder holds another run than the one that was asked for."""


EPISODES_PER_SHARD = 25
"""Fixed, because the network's last bits depend on what is read together."""

CEILING, BOUND = "ceiling", "bound"
"""Stand for deciders in the keys of shards that say what full information solves, and what planners can expect."""


@dataclass(frozen=True)
class ShardKey:
    """Which episodes a shard holds: the ``number``-th lot of one decider (or the ceiling, or the bound) and target."""

    decider: str
    target: str
    number: int

    @property
    def stem(self) -> str:
        """File name without its ending."""
        return f"{self.decider}-{self.target}-{self.number:05d}"

    @classmethod
    def from_stem(cls, stem: str) -> ShardKey:
        """The key from its file name; names of deciders hold no hyphen, those of targets may."""
        decider, rest = stem.split("-", 1)
        target, number = rest.rsplit("-", 1)
        return cls(decider, target, int(number))

    @property
    def is_played(self) -> bool:
        """Whether it holds searches of a decider."""
        return self.decider not in (CEILING, BOUND)

    @property
    def num_lines(self) -> int:
        """Of a whole shard."""
        return 1 if self.decider == BOUND else EPISODES_PER_SHARD

    @property
    def episodes(self) -> range:
        """Numbers of its episodes."""
        return range(self.number * EPISODES_PER_SHARD, (self.number + 1) * EPISODES_PER_SHARD)


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


class RunFolder:
    """Reads and writes one run's folder.

    Args:
        path: the folder; made when first written to.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def open(self, identity: dict[str, Any], arguments: dict[str, Any]) -> str | None:
        """Start a run, or go on with the one that is there.

        Args:
            identity: everything that decides what an episode is; versions of what computes it are added.
            arguments: the rest of what was asked for, recorded only.

        Returns:
            A warning where earlier episodes were played by other code; None otherwise.

        Raises:
            RunMismatch: the folder holds a run with another identity.
            CorruptFile: its ``run.json`` is torn or foreign.
            CannotWrite: it is a file, there is no room, or no permission.
        """
        file, commit, warning = self.path / "run.json", _commit(), None
        wanted = json.loads(json.dumps({**identity, "versions": versions()}))
        if file.exists():
            earlier = self.read_run()
            found = earlier["identity"]
            if found != wanted:
                differing = sorted(key for key in {*found, *wanted} if found.get(key) != wanted.get(key))
                raise RunMismatch(
                    f"{self.path} holds a run with other {', '.join(differing)}. Choose another --out, or delete it."
                )
            if earlier["commit"] != commit:
                warning = f"{self.path} has episodes of commit {earlier['commit']}, this is {commit}; they are kept"
        self.write_run({"identity": wanted, "arguments": arguments, "commit": commit})
        return warning

    def write_run(self, run: dict[str, Any]) -> None:
        """Write ``run.json``."""
        with self._writing():
            write_text(self.path / "run.json", json.dumps(run, indent=1) + "\n")

    def read_run(self) -> dict[str, Any]:
        """What ``run.json`` says.

        Raises:
            FileNotFoundError: there is none.
            CorruptFile: it is torn or foreign.
        """
        file = self.path / "run.json"
        if not file.exists():
            raise FileNotFoundError(f"{self.path} holds no run; make one with: activetouch compare --out {self.path}")
        try:
            run = json.loads(file.read_text(encoding="utf-8"))
            if run.keys() >= {"identity", "arguments", "commit"}:
                return run
            problem = f"it has {', '.join(run) or 'nothing'}"
        except (ValueError, AttributeError) as error:
            problem = str(error)
        raise CorruptFile(
            f"{file} does not say what was run: {problem}. Choose another --out; or delete that file, if you are sure "
            "that the episodes beside it are of the run that you ask for"
        )

    def has(self, key: ShardKey) -> bool:
        """Whether a shard is there and whole."""
        try:
            self.seconds(key)
            lines = self.lines(key)
        except (OSError, ValueError, TypeError):
            return False
        return len(lines) == key.num_lines and all(line.startswith("{") and line.endswith("}\n") for line in lines)

    def complete_keys(self) -> list[ShardKey]:
        """All whole shards, in the order of their names."""
        stems = sorted(path.stem for path in (self.path / "shards").glob("[!.]*.jsonl"))
        return [key for key in map(ShardKey.from_stem, stems) if self.has(key)]

    def write(self, key: ShardKey, lines: Sequence[str], seconds: Seconds) -> None:
        """Write a finished shard; the episodes last, because they mark it complete.

        Raises:
            CannotWrite: there is no room, or no permission; what was there before still is.
        """
        with self._writing():
            write_text(self._shard(key).with_suffix(".time.json"), json.dumps(asdict(seconds)) + "\n")
            write_text(self._shard(key), "".join(lines))

    def write_episodes(self, lines: Iterable[str]) -> None:
        """Write ``episodes.jsonl``."""
        with self._writing(), atomic_path(self.path / "episodes.jsonl") as temporary, temporary.open("w") as file:
            file.writelines(lines)

    def lines(self, key: ShardKey) -> list[str]:
        """The episodes of a shard, a line of JSON each."""
        file = self._shard(key)
        if not file.exists():
            raise FileNotFoundError(f"{file} is not there; play it with: activetouch compare --out {self.path}")
        return file.read_text(encoding="utf-8").splitlines(keepends=True)

    def seconds(self, key: ShardKey) -> Seconds:
        """The time of a complete shard."""
        return Seconds(**json.loads(self._shard(key).with_suffix(".time.json").read_text()))

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except CannotWrite:
            raise
        except OSError as error:
            if not self.path.is_dir() and isinstance(error, FileExistsError | NotADirectoryError):
                raise CannotWrite(
                    f"{self.path} is no folder, and none can be made there; choose another --out"
                ) from error
            raise CannotWrite(
                f"{self.path} cannot be written to: {error.strerror or error}. What is in it is kept; make room, and "
                "run the same command to go on"
            ) from error

    def _shard(self, key: ShardKey) -> Path:
        return self.path / "shards" / f"{key.stem}.jsonl"


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


def _commit() -> str:
    """Commit of the checkout this code runs from, marked if it has changes; empty outside a checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
