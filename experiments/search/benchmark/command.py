"""``activetouch benchmark``: play a task with an agent into a submission file, or check such files."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from belief.constraints import Ending, Probability
from belief.files import require_writable_file
from belief.table import Table
from experiments.command_line.arguments import BadArgument, Jobs, check_arguments
from experiments.parallel import default_jobs
from experiments.search.benchmark.cards import Card
from experiments.search.benchmark.checking import check, remarks, tables
from experiments.search.benchmark.hidden import HiddenSeeds
from experiments.search.benchmark.submission import (
    DEVELOPMENT,
    FORMAT,
    Header,
    Submission,
    processor,
)
from planners import Decider
from planners.fingerprint import code_versions
from planners.process_agent import ProcessAgent, is_without_network

_DECIDER, _FOLDER = "decider:", "folder:"
_LONGEST_WORDS = 300  # characters


class Refused(BadArgument):
    """A submission did not pass its check."""


@dataclass(frozen=True)
class Benchmark:
    """Score an agent on a task, and write its submission file; or check such files, and print the table.

    Without options, the tasks are listed. docs/benchmark.md has the rules, and says how to send a file.

    For example:

        activetouch benchmark --task coarse-v1 --agent policy:mine:act --out mine.jsonl.gz
        activetouch benchmark --task coarse-v1 --agent "process:perl agent.pl" --out perl.jsonl.gz
        activetouch benchmark --check mine.jsonl.gz perl.jsonl.gz
    """

    agent: str | None = None
    """A decider, as of compare: decider:NAME or NAME, module:attribute, sb3:FILE, policy:module:attribute; or
    process:COMMAND, a program in any language; or folder:PATH, whose command.txt starts one without network."""
    task: str = "coarse-v1"
    """Name of a task card."""
    words: str = ""
    """One line on the agent, which the file keeps."""
    out: Annotated[Path, Ending((".gz",))] = Path("runs/submission.jsonl.gz")
    """File to write."""
    check: tuple[Path, ...] = ()
    """Play nothing new; check these files."""
    share: Probability = 1.0
    """With --check: share of the searches that are played again."""
    seeds: Path | None = None
    """File of hidden seeds, in place of the development seeds; also to check a file of these."""
    commit: str | None = None
    """Make hidden seeds for a release with this name, in the file --seeds, and print the digest to commit."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""

    def run(self) -> None:
        """Play, or check; the command fails if a file is refused."""
        check_arguments(self)
        if self.commit is not None:
            if self.seeds is None:
                raise BadArgument("--commit needs --seeds FILE, where the secret is kept")
            made = HiddenSeeds.create(self.seeds, self.commit)
            print(f'wrote {self.seeds}: keep it; commit to commitments.json: "{made.release}": "{made.digest}"')
            return
        hidden = None if self.seeds is None else HiddenSeeds.load(self.seeds)
        if self.check:
            if self.agent is not None:
                raise BadArgument("--agent plays and --check checks: one at a time")
            entries = check(self.check, self.share, hidden, self.jobs)
            print(*tables(entries), *remarks(entries), sep="\n\n")
            if refused := [str(entry.path) for entry in entries if entry.faults]:
                raise Refused(f"{len(refused)} of {len(entries)} files refused: {', '.join(refused)}")
        elif self.agent is not None:
            self._play(self.agent, hidden)
        else:
            print(listed(Card.every()))

    def _play(self, agent: str, hidden: HiddenSeeds | None) -> None:
        card = Card.named(self.task)
        require_writable_file(self.out)
        if self.out.exists() and (other := Submission.load(self.out).header.agent) != named(agent):
            raise BadArgument(f"{self.out} holds the searches of {other}: give another --out, or remove it")
        submission, why = play(card, agent, self.words, hidden, self.jobs)
        submission.save(self.out)
        beside = card.beside()
        known = [beside] if beside.rows else []
        print(*tables(check([self.out], 0.0, hidden)), *known, *filter(None, [why]), f"wrote {self.out}", sep="\n\n")


def play(
    card: Card, agent: str, words: str = "", hidden: HiddenSeeds | None = None, jobs: int | None = None
) -> tuple[Submission, str]:
    """Play all searches of a task with an agent, which is named as on the command line; and why it failed, in words.

    Args:
        card: the task.
        agent: name of the agent.
        words: one line on it.
        hidden: hidden seeds in place of those of the card.
        jobs: number of processes; all cores by default.

    Raises:
        BadArgument: there is more than one line of words, or this installation has another sensor than the task.
        BrokenContract: the agent cannot be started, or answers wrongly.
    """
    if len(words) > _LONGEST_WORDS or not words.isprintable():
        raise BadArgument(f"--words is one line of at most {_LONGEST_WORDS} characters")
    name = named(agent)
    player: Decider | str = name
    if agent.startswith(_FOLDER):
        player = ProcessAgent.of_folder(Path(agent.removeprefix(_FOLDER)))
        if not is_without_network():
            print("this machine has no unshare: the agent keeps its network", file=sys.stderr)
    jobs = default_jobs() if jobs is None else jobs
    started = time.perf_counter()
    batches, why = card.play(name, player, jobs, None if hidden is None else hidden.seed(card))
    elapsed = time.perf_counter() - started
    seeds = DEVELOPMENT if hidden is None else hidden.digest
    about = (FORMAT, card.name, card.digest, name, words, seeds, code_versions(), processor())
    return Submission(Header(*about, jobs, elapsed), batches), why


def named(agent: str) -> str:
    """Name of an agent in its file: a folder by its last part."""
    folder = Path(agent.removeprefix(_FOLDER)).resolve().name
    return f"{_FOLDER}{folder}" if agent.startswith(_FOLDER) else agent.removeprefix(_DECIDER)


def listed(cards: list[Card]) -> Table:
    """The tasks in a table."""
    rows = [(card.name, card.num_objects, len(card.sought) * card.episodes, card.bound, card.summary) for card in cards]
    columns = ["task", ("objects", "d"), ("searches", "d"), ("bound", ".3f"), ("what", "")]
    return Table("Tasks", columns, rows)
