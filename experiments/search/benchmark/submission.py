"""A submission: what an agent did in all searches of a task, as one compressed file of JSON lines.

The first line is the header, with a digest of the others; each other line is a batch of searches, as they were played
together, with their times. Objects and touches are not in the file: they follow from seeds and actions. Reading a file
runs no code that it names, and what it may hold is bounded.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import platform
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from belief.codec import from_fields, to_fields
from belief.errors import InvalidArgument
from belief.files import atomic_path, require_regular_file, sealed_json, unsealed_json
from belief.problem import Probe
from experiments.command_line.arguments import BadArgument
from experiments.search.play import Seconds
from experiments.search.run import Run, read_episode
from planners import Episode
from planners.episode import ACTION_NAMES

FORMAT = 1
DEVELOPMENT = "development"
"""What a header says of the seeds that a card names; of hidden ones it says the digest of their file."""
_MOST_COMPRESSED, _MOST_BYTES, _LONGEST_TEXT = 8 << 20, 64 << 20, 400
DIGITS, HEX = 6, 16
"""Of stated probabilities, and of digests of touches."""


@dataclass(frozen=True)
class Header:
    """Who played what, where, and how long it took.

    Attributes:
        agent: its name, as on the command line.
        words: what its author says of it.
        seeds: :data:`DEVELOPMENT`, or the digest of the file of hidden seeds.
        versions: of packages, with the commit and a digest of this code.
        elapsed: from the first search to the last [s]; ``jobs`` processes played.
        body_sha256: digest of the lines after the header.
    """

    format: int
    task: str
    task_sha256: str
    agent: str
    words: str
    seeds: str
    versions: Mapping[str, str]
    processor: str
    jobs: int
    elapsed: float
    body_sha256: str = ""


@dataclass(frozen=True)
class Played:
    """One search.

    Attributes:
        actions: index of a pose, or a word, in their order.
        probs: stated probability that the current object is the target, before each action.
        touches: digest of what was felt in all touches; of nothing if there were none.
        outcome: how it ended.
        success: whether that was right.
    """

    actions: tuple[int | str, ...]
    probs: tuple[float, ...]
    touches: str
    outcome: str
    success: bool

    @classmethod
    def of(cls, episode: Episode) -> Played:
        """What is kept of a search."""
        felt, actions = hashlib.sha256(), list[int | str]()
        for step in episode.steps:
            action = step.decision.action
            actions.append(action.pose if isinstance(action, Probe) else ACTION_NAMES[type(action)])
            if step.touch is not None:
                read = step.touch.features if step.touch.logits is None else step.touch.logits
                felt.update(np.asarray(read, np.float64).tobytes())
        probs = (min(float(step.belief.probs[episode.target]), 1.0) for step in episode.steps)
        stated = tuple(round(prob, DIGITS) for prob in probs)
        return cls(tuple(actions), stated, felt.hexdigest()[:HEX], episode.outcome.value, bool(episode.success))

    @property
    def num_touches(self) -> int:
        """Probes, without the one that a touch limit refused."""
        return sum(isinstance(action, int) for action in self.actions) - (self.outcome == "truncated")


@dataclass(frozen=True)
class PlayedBatch:
    """Searches for a target that were played together, from the number ``first`` on, and what they took."""

    target: str
    first: int
    seconds: Seconds
    searches: tuple[Played, ...]


@dataclass(frozen=True)
class Submission:
    """The content of a file."""

    header: Header
    batches: Sequence[PlayedBatch]

    @property
    def searches(self) -> list[Played]:
        """All searches, batch by batch."""
        return [search for batch in self.batches for search in batch.searches]

    @property
    def seconds(self) -> Seconds:
        """What all searches took."""
        return sum((batch.seconds for batch in self.batches), Seconds())

    def content(self) -> bytes:
        """The file, the same for the same submission."""
        body = "".join(json.dumps(to_fields(batch), allow_nan=False) + "\n" for batch in self.batches)
        digest = hashlib.sha256(body.encode()).hexdigest()
        head = sealed_json(to_fields(self.header) | {"body_sha256": digest}, indent=None)
        return gzip.compress(f"{head}\n{body}".encode(), mtime=0)

    def save(self, path: Path) -> None:
        """Write the file."""
        with atomic_path(path) as temporary:
            temporary.write_bytes(self.content())

    @classmethod
    def load(cls, path: Path) -> Submission:
        """Read a file; raises BadArgument for one that holds no submission."""
        try:
            head, *body = _lines(path)
            header = from_fields(Header, unsealed_json(head))
            if header.format != FORMAT:
                raise InvalidArgument(f"it has format {header.format}; this version reads {FORMAT}")
            if hashlib.sha256("".join(f"{line}\n" for line in body).encode()).hexdigest() != header.body_sha256:
                raise InvalidArgument("it was changed after it was written: its lines do not match their SHA-256")
            texts = (header.agent, header.words, header.seeds, header.processor, header.task)
            if not all(len(text) <= _LONGEST_TEXT and text.isprintable() for text in texts):
                raise InvalidArgument(
                    f"a text of the header is longer than {_LONGEST_TEXT} characters, or not printable"
                )
            return cls(header, [from_fields(PlayedBatch, _parsed(line)) for line in body])
        except (ValueError, TypeError, KeyError, RecursionError, EOFError, OSError, zlib.error) as error:
            raise BadArgument(f"{path} holds no submission: {str(error)[:_LONGEST_TEXT]}") from error


def _lines(path: Path) -> list[str]:
    """The lines of a compressed file of a bounded size."""
    with require_regular_file(path, BadArgument).open("rb") as file:
        content = file.read(_MOST_COMPRESSED + 1)
    if len(content) > _MOST_COMPRESSED:
        raise InvalidArgument(f"it has more than {_MOST_COMPRESSED} bytes")
    with gzip.GzipFile(fileobj=io.BytesIO(content)) as opened:
        text = opened.read(_MOST_BYTES + 1)
    if len(text) > _MOST_BYTES:
        raise InvalidArgument(f"it holds more than {_MOST_BYTES} bytes")
    if not (lines := text.decode("ascii").splitlines()):
        raise InvalidArgument("it is empty")
    return lines


def _parsed(line: str) -> Any:
    def refuse(name: str) -> Any:
        raise InvalidArgument(f"{name} is no finite number")

    return json.loads(line, parse_constant=refuse)


def batches_of(run: Run, name: str) -> Iterable[tuple[PlayedBatch, list[Episode]]]:
    """The finished searches of a decider in a run, batch by batch: what a file keeps of them, and all."""
    labels = tuple(run.searches.problem.shape_labels)
    for (decider, target), key in run.keys.items():
        if decider == name:
            for _, batch in sorted(run.folder.held((decider, target), key).items()):
                episodes = [read_episode(line, labels) for line in batch.lines]
                first = episodes[0].seed[-1]
                yield PlayedBatch(target, first, batch.seconds, tuple(map(Played.of, episodes))), episodes


@lru_cache(maxsize=1)
def processor() -> str:
    """The kind of processor, in words: touches repeat to the last bit on one kind.

    A virtual machine may hide the name; the family and the model number tell apart what computes in other ways.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    parts = (line.partition(":") for line in reversed(lines))  # of equal names, the first processor's
    known = {name.strip(): value.strip() for name, _, value in parts}
    numbers = "/".join(known[name] for name in ("cpu family", "model", "stepping") if name in known)
    name = f"{platform.machine()} {known.get('model name') or platform.processor()} {numbers}"
    return name.strip()[:_LONGEST_TEXT]
