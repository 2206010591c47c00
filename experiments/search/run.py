"""A comparison that is played: which batches are missing, and tasks that play them."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from belief.errors import ActiveTouchError
from experiments.parallel import Shared, Task, run_tasks
from experiments.search.fingerprint import digest_of, fingerprint
from experiments.search.play import EPISODES_PER_BATCH, Searches, play_episodes
from experiments.search.run_folder import Batch, Cell, RunFolder, episode_lines
from planners import Decider


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
        """Digest of everything that determines the episodes of a cell (decision 0028)."""
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
        self.folder.write_episodes(self.lines())

    def lines(self) -> dict[Cell, list[str]]:
        """JSON lines of the finished episodes by cell."""
        return {cell: self.folder.lines(cell, key)[: self.episodes] for cell, key in self.keys.items()}

    def _tasks(self) -> list[Task[tuple[Cell, int, Batch]]]:
        """The missing batches in random order, so that processes that fill one folder rarely play the same."""
        shared, tasks = Shared((self.searches, self.deciders)), []
        for cell, key in self.keys.items():
            held = self.folder.held(cell, key)
            for number, first in enumerate(range(0, self.episodes, EPISODES_PER_BATCH)):
                numbers = range(first, min(first + EPISODES_PER_BATCH, self.episodes))
                if number not in held or len(held[number].lines) < len(numbers):
                    tasks.append(partial(_play_batch, shared, cell, number, numbers))
        return [tasks[index] for index in np.random.default_rng().permutation(len(tasks))]

    def _tell_outdated(self) -> None:
        """Say on stderr which deciders have searches of another version only, which are played again."""
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
    try:
        episodes, seconds = play_episodes(searches, deciders[name], searches.problem.shape_labels.index(label), numbers)
    except ActiveTouchError as error:
        error.add_note(f"in one of the episodes {numbers} of {name}, target {label}, seed {searches.seed}")
        raise
    return cell, number, Batch(episode_lines(name, episodes), seconds)
