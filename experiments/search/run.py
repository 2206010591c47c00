"""A comparison that is played, and its folder: ``run.json``, and the finished searches of each decider and target.

run.json         what determines all searches of the folder, the latest arguments, and the seal of episodes.jsonl
cells/*.jsonl    searches of a decider for a target, in batches of 25
episodes.jsonl   the searches of the latest comparison

A cell grows by one line at a time: a batch with its key, its number, the JSON lines of its episodes and a digest. The
key is a digest of everything that determines the episodes (:attr:`Run.keys`). A batch that is damaged, unfinished or of
another key counts as missing.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

from belief.errors import ActiveTouchError, CorruptFile
from belief.files import (
    atomic_path,
    cannot_write,
    claim_folder,
    ends_claims,
    in_file_name,
    require_regular_file,
    sealed_json,
    unsealed_json,
    write_text,
)
from belief.references import ForeignCode
from experiments.command_line.arguments import Trust
from experiments.parallel import Shared, Task, run_tasks
from experiments.scene_choice import command
from experiments.search.play import EPISODES_PER_BATCH, Searches, Seconds, play_episodes
from planners import Decider, Episode
from planners.fingerprint import commit_of_code, digest_of, fingerprint

_FORMAT = 4
_FIELDS = {"format": int, "identity": dict, "arguments": dict, "commit": str}
Cell: TypeAlias = tuple[str, str]
"""Name of a decider, and label of a target."""


class RunMismatch(ActiveTouchError, ValueError):
    """A folder or file holds another run than the requested one."""


@dataclass(frozen=True)
class Batch:
    """Up to 25 consecutive episodes: the JSON line of each, and the time that they took."""

    lines: Sequence[str]
    seconds: Seconds


class RunFolder:
    """Reads and writes a run folder, which the first write creates; without a path, batches are kept in memory."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self._known: dict[Cell, dict[str, dict[int, Batch]]] = {}

    def require(self, identity: Mapping[str, Any]) -> None:
        """Check that the folder holds searches with this identity, or the given part of one, or none."""
        if self.path is None or not (self.path / "run.json").exists():
            return
        if other := differing(self.read_run()["identity"], identity):
            raise RunMismatch(
                f"{self.path} holds another run: {other}. Give this run a folder of its own: --out {self.path}-2"
            )

    def start(
        self, identity: Mapping[str, Any], arguments: Mapping[str, Any], sealed: Mapping[str, Any] | None = None
    ) -> None:
        """Write ``run.json``, with the arguments of the comparison; it keeps its seal unless one is given."""
        if self.path is None:
            return
        run = {"format": _FORMAT, "identity": identity, "arguments": arguments, "commit": commit_of_code()}
        file = self.path / "run.json"
        if file.exists():
            self.require(identity)
            sealed = self.read_run().get("episodes") if sealed is None else sealed
        write_text(file, sealed_json({**run, "episodes": sealed}) + "\n")

    def finish(
        self, identity: Mapping[str, Any], arguments: Mapping[str, Any], lines: Mapping[Cell, list[str]]
    ) -> None:
        """Write ``episodes.jsonl``, as :meth:`latest` reads it, and its seal into ``run.json``; see :meth:`start`."""
        self.require(identity)
        if self.path is not None:
            content = "".join(chain.from_iterable(lines.values())).encode()
            with atomic_path(self.path / "episodes.jsonl") as temporary:
                temporary.write_bytes(content)
            self.start(identity, arguments, _seal(content))

    def read_run(self) -> dict[str, Any]:
        """The content of ``run.json``."""
        assert self.path is not None, "only a folder has a run.json"
        file = self.path / "run.json"
        if not file.exists():
            raise FileNotFoundError(f"{self.path} holds no run; start one with:\n{command('compare', out=self.path)}")
        try:
            run = unsealed_json(require_regular_file(file).read_text(encoding="utf-8"))
            if run.get("format", 1) != _FORMAT:
                raise ValueError(
                    f"it has format {run.get('format', 1)} of another version, and this one reads {_FORMAT}"
                )
            if wrong := [name for name, kind in _FIELDS.items() if not isinstance(run.get(name), kind)]:
                raise ValueError(f"these fields are missing or of a wrong type: {', '.join(wrong)}")
        except ValueError as error:
            raise CorruptFile(
                f"{file} does not describe a run: {error}. Choose another --out, or delete this folder"
            ) from error
        return run

    def command(self, name: str, **options: object) -> str:
        """A command line about this run, with ``--trust`` where ``run.json`` names code."""
        given, trust = self.read_run()["arguments"], Trust(self.path or Path())
        names = re.findall(r'"([^"]*)"', json.dumps(given.get("deciders")))  # a file may hold other types
        names += re.findall(r'"(?:scene|renderer)": "([^"]*)"', json.dumps(given.get("setting")))
        return command(name, *(() if all(map(trust.allows, names)) else ("--trust",)), **options)

    def batches(self, cell: Cell) -> dict[str, dict[int, Batch]]:
        """The intact batches of a cell, by key and number, oldest first; of several, the one with most episodes."""
        if cell not in self._known:
            self._known[cell] = {}
            if self.path is not None and (file := self.path / "cells" / _file_name(cell)).exists():
                for key, number, batch in _read_batches(require_regular_file(file)):
                    self._hold(cell, key, number, batch)
        return self._known[cell]

    def _hold(self, cell: Cell, key: str, number: int, batch: Batch) -> None:
        held = self.batches(cell).setdefault(key, {})
        if number not in held or len(held[number].lines) <= len(batch.lines):
            held[number] = batch

    def held(self, cell: Cell, key: str) -> dict[int, Batch]:
        """Batches of a cell with this key, by number."""
        return self.batches(cell).get(key, {})

    def lines(self, cell: Cell, key: str) -> list[str]:
        """JSON lines of the episodes with this key, from the first up to one that is missing."""
        held, lines = self.held(cell, key), list[str]()
        while len(lines) % EPISODES_PER_BATCH == 0 and (batch := held.get(len(lines) // EPISODES_PER_BATCH)):
            lines += batch.lines
        return lines

    def add(self, cell: Cell, key: str, number: int, batch: Batch) -> None:
        """Append a batch, by its key and number, to a cell."""
        self._hold(cell, key, number, batch)
        if self.path is None:
            return
        file = self.path / "cells" / _file_name(cell)
        fields = {"key": key, "batch": number, "lines": list(batch.lines), "seconds": asdict(batch.seconds)}
        content = f"{sealed_json(fields, indent=None)}\n".encode()
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with file.open("a+b") as opened:
                end = opened.seek(0, os.SEEK_END)
                opened.seek(max(end - 1, 0))
                unfinished = end and opened.read(1) != b"\n"  # what a kill or a full disk left
                opened.write(b"\n" + content if unfinished else content)
                opened.flush()
                os.fsync(opened.fileno())
        except OSError as error:
            raise cannot_write(file, error) from error

    def latest(self, labels: Sequence[str]) -> dict[Cell, list[str]]:
        """JSON lines of the episodes of the latest comparison; the labels are of all shapes."""
        assert self.path is not None, "only a folder has a file of episodes"
        again = self.command("compare", config=self.path / "run.json")
        if not (file := self.path / "episodes.jsonl").exists():
            raise FileNotFoundError(f"{self.path} holds no finished comparison; finish it with:\n{again}")
        content, sealed = require_regular_file(file).read_bytes(), self.read_run().get("episodes")
        if (differs := _differs(sealed, _seal(content))) is not None:
            raise CorruptFile(
                f"{file} is not what the comparison wrote: {differs}. Repeat the call that wrote it, or run:\n{again}"
            )
        found = dict[Cell, list[str]]()
        for number, line in enumerate(content.splitlines(keepends=True)):
            try:
                fields = json.loads(line)
                found.setdefault((fields["decider"], labels[fields["target"]]), []).append(line.decode())
            except (ValueError, LookupError, TypeError) as error:
                raise CorruptFile(f"{file}, line {number + 1}: not an episode of this run: {error!r}") from error
        if not found:
            raise CorruptFile(f"{file} has no episodes")
        return found

    def seconds(self, cell: Cell, lines: Sequence[str]) -> Seconds:
        """The time that the batches of these episodes took."""
        known, spent = set(lines), dict[int, Seconds]()
        for held in self.batches(cell).values():
            spent |= {number: batch.seconds for number, batch in held.items() if batch.lines[0] in known}
        return sum(spent.values(), Seconds())


def _seal(content: bytes) -> dict[str, Any]:
    """Number of lines and digest of a file of episodes, as ``run.json`` keeps them."""
    return {"lines": content.count(b"\n"), "sha256": hashlib.sha256(content).hexdigest()}


def _differs(sealed: Any, found: Mapping[str, Any]) -> str | None:
    """How a file of episodes differs from its seal, in words; None if it does not."""
    if not isinstance(sealed, Mapping):
        return "run.json has no digest of it, so its comparison did not finish, or was played by an earlier version"
    if sealed.get("lines") != found["lines"]:
        return f"it has {found['lines']} lines, and run.json says {sealed.get('lines')}"
    return None if sealed == found else "it was changed, its content does not match its digest in run.json"


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """The parts of the second identity, or of a part of one, in which the first differs, in words; empty for none."""
    in_words = {
        "problem": "search (shapes, --num-objects, --touch-cost, --abstain, --certificate)",
        "scene": "scene (shapes, hand, presses)",
        "sensor_sha256": "sensor",
    }
    keys = sorted(key for key in other if one.get(key) != other[key])
    return "; ".join(f"other {in_words.get(key, key)}" for key in keys)


def episode_lines(decider: str, episodes: Iterable[Episode]) -> list[str]:
    """One JSON line per episode."""
    return [json.dumps({"decider": decider, **episode.to_dict()}) + "\n" for episode in episodes]


def read_episode(line: str, shape_labels: tuple[str, ...]) -> Episode:
    """Read an episode from its JSON line."""
    return Episode.from_dict(json.loads(line), shape_labels)


def _file_name(cell: Cell) -> str:
    """A file name of a cell, which is unique and valid on every file system.

    >>> _file_name(("mine:TwoLooks(touches=4)", "cone"))
    'mine%3ATwoLooks%28touches%3D4%29-cone.jsonl'
    """
    decider, target = cell
    return f"{in_file_name(decider)}-{in_file_name(target, '-')}.jsonl"


def _read_batches(file: Path) -> Iterator[tuple[str, int, Batch]]:
    """Key, number and content of each intact batch."""
    for line in file.read_bytes().decode("utf-8", errors="replace").splitlines():
        try:
            found = unsealed_json(line)
            yield found["key"], found["batch"], Batch(found["lines"], Seconds(**found["seconds"]))
        except (ValueError, TypeError, KeyError):
            continue


@dataclass(frozen=True, eq=False)
class Run:
    """Searches of several deciders for several targets, of which some may be finished.

    ``arguments`` of the comparison go into ``run.json``; ``known`` are objects, by name, that deciders hold and that
    the searches determine.
    """

    searches: Searches
    deciders: Mapping[str, Decider]
    targets: Sequence[str]
    episodes: int
    folder: RunFolder
    arguments: Mapping[str, Any]
    known: Mapping[str, object] = field(default_factory=dict)

    @cached_property
    def keys(self) -> dict[Cell, str]:
        """Digest of everything that determines the episodes of a cell (decision 0028)."""
        base = [self.searches.identity, self.searches.code]
        return {
            (name, target): digest_of([base, fingerprint(player, target, self.known)])
            for name, player in self.deciders.items()
            for target in self.targets
        }

    @ends_claims
    def play(self, jobs: int | None = None) -> None:
        """Play the batches that the folder lacks on several processes; each is kept as soon as it is finished.

        One run at a time may write into a folder.
        """
        if self.folder.path is not None:
            claim_folder(self.folder.path)
        self.folder.require(self.searches.identity)
        self._tell_outdated()
        is_started = False
        for cell, number, batch in run_tasks(self._tasks(), jobs, "searching"):
            if not is_started:  # a run that fails without any result must not claim the folder
                self.folder.start(self.searches.identity, self.arguments)
                is_started = True
            self.folder.add(cell, self.keys[cell], number, batch)
        self.folder.finish(self.searches.identity, self.arguments, self.lines())

    def lines(self) -> dict[Cell, list[str]]:
        """JSON lines of the finished episodes by cell."""
        return {cell: self.folder.lines(cell, key)[: self.episodes] for cell, key in self.keys.items()}

    def _tasks(self) -> list[Task[tuple[Cell, int, Batch]]]:
        """The missing batches."""
        shared, tasks = Shared((self.searches, self.deciders)), list[Task[tuple[Cell, int, Batch]]]()
        for cell, key in self.keys.items():
            held = self.folder.held(cell, key)
            for number, first in enumerate(range(0, self.episodes, EPISODES_PER_BATCH)):
                numbers = range(first, min(first + EPISODES_PER_BATCH, self.episodes))
                if number not in held or len(held[number].lines) < len(numbers):
                    tasks.append(partial(_play_batch, shared, cell, number, numbers))
        return tasks

    def _tell_outdated(self) -> None:
        """Say on stderr which deciders have only searches of another version, which are played again."""
        stored = {cell: self.folder.batches(cell) for cell in self.keys}
        outdated = dict.fromkeys(cell[0] for cell, by_key in stored.items() if by_key and self.keys[cell] not in by_key)
        if outdated:
            print(
                f"{self.folder.path} has searches of another version (code, settings or policies), which are played "
                f"again: {', '.join(outdated)}",
                file=sys.stderr,
            )


def _play_batch(
    shared: Shared[tuple[Searches, Mapping[str, Decider]]], cell: Cell, number: int, numbers: range
) -> tuple[Cell, int, Batch]:
    """Play the episodes of one batch of a cell."""
    (searches, deciders), (name, label) = shared.value, cell
    with ForeignCode(f"in one of the episodes {numbers} of {name}, target {label}, seed {searches.seed}"):
        episodes, seconds = play_episodes(searches, deciders[name], searches.problem.shape_labels.index(label), numbers)
    return cell, number, Batch(episode_lines(name, episodes), seconds)
