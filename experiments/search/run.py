"""A comparison that is played: which batches are missing, and tasks that play them."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from belief.errors import ActiveTouchError
from experiments.parallel import Shared, run_tasks
from experiments.search.fingerprint import digest_of, fingerprint
from experiments.search.play import EPISODES_PER_BATCH, Searches, Seconds, play_episodes
from experiments.search.run_folder import Batch, Cell, RunFolder, episode_lines
from planners import Decider


@dataclass(frozen=True)
class Task:
    """Plays a batch of episodes.

    Attributes:
        shared: what determines the searches, and the deciders by name.
        cell: name of the decider and label of the target.
        number: number of the batch.
        size: number of episodes.
    """

    shared: Shared[tuple[Searches, Mapping[str, Decider]]]
    cell: Cell
    number: int
    size: int

    def __call__(self) -> tuple[Cell, int, Batch]:
        """The batch, with its cell and number."""
        (searches, deciders), (name, label) = self.shared.value, self.cell
        target = list(searches.problem.shape_labels).index(label)
        first = self.number * EPISODES_PER_BATCH
        numbers = range(first, first + self.size)
        try:
            episodes, seconds = play_episodes(searches, deciders[name], target, numbers)
        except ActiveTouchError as error:
            error.add_note(f"in one of the episodes {numbers} of {name}, target {label}, seed {searches.seed}")
            raise
        return self.cell, self.number, Batch(episode_lines(name, episodes), seconds)


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
        """Play the batches that the folder lacks on several processes; each is kept as soon as it is finished.

        Raises:
            RunMismatch: The folder holds another run.
            CannotWrite: The disk is full, or the folder is not writable.
        """
        self.folder.require(self.searches.identity)
        self._tell_outdated()
        is_started = False
        for cell, number, batch in run_tasks(self._tasks(), jobs, "searching"):
            if not is_started:  # a run that fails without any result must not claim the folder
                self.folder.start(self.searches.identity, self.arguments)
                is_started = True
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

    def _tasks(self) -> list[Task]:
        """The missing batches in random order, so that processes that fill one folder rarely play the same."""
        shared, batches = Shared((self.searches, self.deciders)), range(-(-self.episodes // EPISODES_PER_BATCH))
        sizes = {(cell, number): self._missing(cell, number) for cell in self.keys for number in batches}
        tasks = [Task(shared, cell, number, size) for (cell, number), size in sizes.items() if size]
        return [tasks[index] for index in np.random.default_rng().permutation(len(tasks))]

    def _missing(self, cell: Cell, number: int) -> int:
        """Size of a batch; 0 if the folder holds it."""
        size = min(self.episodes - number * EPISODES_PER_BATCH, EPISODES_PER_BATCH)
        held = self.folder.held(cell, self.keys[cell]).get(number)
        return 0 if held is not None and len(held.lines) >= size else size

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
