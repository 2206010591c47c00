"""A comparison that is played: which batches are missing, and tasks that play them."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from belief.errors import ActiveTouchError
from experiments.parallel import Shared, run_tasks
from experiments.search.fingerprint import digest_of, fingerprint
from experiments.search.play import EPISODES_PER_BATCH, Searches, Seconds, TouchMemo, play_episodes
from experiments.search.run_folder import Batch, Cell, RunFolder, episode_lines
from planners import Decider


@dataclass(frozen=True)
class Task:
    """Plays the same episodes with one or several deciders, which share the images of their touches.

    Attributes:
        shared: what determines the searches, and the deciders by name.
        target: label of the target shape.
        number: number of the batch.
        sizes: number of episodes by name of the decider.
    """

    shared: Shared[tuple[Searches, Mapping[str, Decider]]]
    target: str
    number: int
    sizes: Mapping[str, int]

    def __call__(self) -> list[tuple[Cell, int, Batch]]:
        """The batches of all deciders."""
        memo = TouchMemo()
        return [((name, self.target), self.number, self._play(name, size, memo)) for name, size in self.sizes.items()]

    def _play(self, name: str, size: int, memo: TouchMemo) -> Batch:
        searches, deciders = self.shared.value
        target = list(searches.problem.shape_labels).index(self.target)
        first = self.number * EPISODES_PER_BATCH
        numbers = range(first, first + size)
        try:
            episodes, seconds = play_episodes(searches, deciders[name], target, numbers, memo)
        except ActiveTouchError as error:
            error.add_note(f"in one of the episodes {numbers} of {name}, target {self.target}, seed {searches.seed}")
            raise
        return Batch(episode_lines(name, episodes), seconds)


@dataclass(frozen=True, eq=False)
class Run:
    """Searches of several deciders for several targets, of which some may be finished.

    Attributes:
        searches: what determines the searches.
        deciders: by name.
        targets: labels of the target shapes.
        episodes: searches of each decider for each target.
        folder: holds what is finished.
        arguments: arguments of the comparison, for ``run.json``.
        known: objects that deciders hold and that the searches determine, by name.
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
        """Digest of everything that determines the episodes of a cell (decision 0033)."""
        base = [self.searches.identity, self.searches.code]
        return {
            (name, target): digest_of([base, fingerprint(player, target, self.known)])
            for name, player in self.deciders.items()
            for target in self.targets
        }

    def play(self, jobs: int | None = None) -> None:
        """Play the batches that the folder lacks; each is kept as soon as it is finished.

        Args:
            jobs: number of processes on this machine; as many as processors if None.

        Raises:
            RunMismatch: The folder holds another run.
            CannotWrite: The disk is full, or the folder is not writable.
        """
        self.folder.require(self.searches.identity)
        self._tell_outdated()
        is_started = False
        for found in run_tasks(self._tasks(jobs), jobs, "searching"):
            if not is_started:  # a run that fails without any result must not claim the folder
                self.folder.start(self.searches.identity, self.arguments)
                is_started = True
            for cell, number, batch in found:
                self.folder.add(cell, self.keys[cell], number, batch)
        self.folder.start(self.searches.identity, self.arguments)
        self.folder.write_episodes(
            chain.from_iterable(self.lines(name, t) for name in self.deciders for t in self.targets)
        )

    def lines(self, decider: str, target: str) -> list[str]:
        """JSON lines of the finished episodes of a decider."""
        cell = decider, target
        return self.folder.lines(cell, self.keys[cell])[: self.episodes]

    def seconds(self, decider: str, target: str) -> Seconds:
        """The time that the batches of these episodes took."""
        return self.folder.seconds((decider, target), self.lines(decider, target))

    def _tasks(self, jobs: int | None) -> list[Task]:
        """What is missing, as tasks that take about equally long, in random order."""
        shared, groups = Shared((self.searches, self.deciders)), list[Task]()
        for target in self.targets:
            for number in range(-(-self.episodes // EPISODES_PER_BATCH)):
                sizes = {name: self._missing(name, target, number) for name in self.deciders}
                groups.append(Task(shared, target, number, {name: size for name, size in sizes.items() if size}))
        groups = [task for task in groups if task.sizes]
        pieces = -(-2 * (jobs or 1) // max(len(groups), 1))  # few groups are divided among the processes
        tasks = [piece for task in groups for piece in _divided(task, pieces)]
        # At random, so that processes that fill the same folder rarely play the same batches.
        return [tasks[index] for index in np.random.default_rng().permutation(len(tasks))]

    def _missing(self, name: str, target: str, number: int) -> int:
        """Size of a batch; 0 if the folder holds it."""
        size = min(self.episodes - number * EPISODES_PER_BATCH, EPISODES_PER_BATCH)
        held = self.folder.held((name, target), self.keys[name, target]).get(number)
        return 0 if size <= 0 or (held is not None and len(held.lines) >= size) else size

    def _tell_outdated(self) -> None:
        """Say on stderr which deciders have searches of another version only, which are played again."""
        stored = {cell: {key for key, _ in self.folder.batches(cell)} for cell in self.keys}
        outdated = dict.fromkeys(name for (name, t), keys in stored.items() if keys and self.keys[name, t] not in keys)
        if outdated:
            print(
                f"{self.folder.path} has searches of another version (code, settings or policies), which are played "
                f"again: {', '.join(outdated)}",
                file=sys.stderr,
            )


def _divided(task: Task, pieces: int) -> Iterator[Task]:
    """A task as several, each with some of its deciders."""
    names = list(task.sizes)
    for first in range(min(pieces, len(names))):
        some = {name: task.sizes[name] for name in names[first::pieces]}
        yield Task(task.shared, task.target, task.number, some)
