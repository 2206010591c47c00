"""Content of a run folder, and the largest comparison that it allows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from belief.problem import SearchProblem
from experiments.search.bound import RevealedBody
from experiments.search.run_folder import (
    BOUND,
    EPISODES_PER_SHARD,
    ORACLE,
    MadeBy,
    RunFolder,
    Seconds,
    Shard,
    ShardKey,
    read_episode,
)
from experiments.search.summary import Comparison, compare_episodes

ORACLE_EPISODES = 50
"""Largest number of episodes per target on which the oracle is run; each takes one touch per object and pose."""


@dataclass(frozen=True)
class Selection:
    """Searches to compare: deciders, targets, and the number of episodes of each, from the first."""

    deciders: tuple[str, ...]
    targets: tuple[str, ...]
    episodes: int

    def __contains__(self, other: object) -> bool:
        """Whether this selection contains all of another."""
        return (
            isinstance(other, Selection)
            and {*other.deciders} <= {*self.deciders}
            and {*other.targets} <= {*self.targets}
            and other.episodes <= self.episodes
        )

    @property
    def size(self) -> int:
        """Total number of searches."""
        return len(self.deciders) * len(self.targets) * self.episodes

    def __str__(self) -> str:
        each = f"{self.episodes} search{'es' * (self.episodes != 1)} each"
        return f"{', '.join(self.deciders)}; targets {', '.join(self.targets)}; {each}"


@dataclass(frozen=True)
class Holdings:
    """Shards of the current deciders (or oracle, or bound), by decider and target, without gaps from the first."""

    shards: Mapping[tuple[str, str], Sequence[Shard]]

    @classmethod
    def of(cls, folder: RunFolder, made_by: MadeBy) -> Holdings:
        """Read the shards of the deciders with these digests, in the order of ``made_by``."""
        found = {
            (decider, target): list(_in_turn(folder, decider, target, digest))
            for decider, by_target in made_by.items()
            for target, digest in by_target.items()
        }
        return cls({cell: shards for cell, shards in found.items() if shards})

    def lines(self, cell: tuple[str, str]) -> list[str]:
        """Episodes of a decider and target, one JSON line each."""
        return list(chain.from_iterable(shard.lines for shard in self.shards.get(cell, ())))

    def episodes(self) -> Iterator[str]:
        """JSON lines of all episodes of deciders."""
        return chain.from_iterable(self.lines(cell) for cell in self.counts())

    def counts(self) -> dict[tuple[str, str], int]:
        """Number of searches by decider and target."""
        return {cell: len(self.lines(cell)) for cell in self.shards if cell[0] not in (ORACLE, BOUND)}

    def largest(self, asked: Selection) -> Selection:
        """The selection with the most searches such that all of its deciders have played the same ones.

        Args:
            asked: requested selection, returned unless another is larger.
        """
        counts = {cell: num for cell, num in self.counts().items() if self._has_oracle(cell[1], num)}
        deciders, targets = (list(dict.fromkeys(cell[place] for cell in counts)) for place in (0, 1))
        best = asked
        for least in sorted(set(counts.values()), reverse=True):
            there = {d: frozenset(t for t in targets if counts.get((d, t), 0) >= least) for d in deciders}
            shared: dict[frozenset[str], None] = {}  # sets of targets that some deciders have in common
            for some in there.values():
                shared |= dict.fromkeys([some, *(some & other for other in shared)])
            for some in shared:
                able = tuple(decider for decider in deciders if some <= there[decider])
                found = Selection(able, tuple(target for target in targets if target in some), least)
                if found.size > best.size or (found.size == best.size and asked in found and asked not in best):
                    best = found
        return best

    def beyond(self, selection: Selection) -> dict[str, int]:
        """Number of searches outside of a selection, by decider."""
        extra: dict[str, int] = {}
        for (decider, target), num in self.counts().items():
            inside = decider in selection.deciders and target in selection.targets
            extra[decider] = extra.get(decider, 0) + num - (selection.episodes if inside else 0)
        return {decider: num for decider, num in extra.items() if num}

    def compare(
        self, problem: SearchProblem, selection: Selection, reference: str, seed: int, bound: bool
    ) -> Comparison:
        """Compute all numbers of a selection.

        Args:
            problem: rules of the search.
            selection: searches to compare; the folder must hold them.
            reference: decider that the others are compared with.
            seed: seed of the bootstraps.
            bound: whether to include the upper bound on the return.
        """
        labels, num = tuple(problem.shape_labels), selection.episodes
        cells = [(decider, target) for decider in selection.deciders for target in selection.targets]
        shards = -(-num // EPISODES_PER_SHARD)
        seconds = {cell: sum((shard.seconds for shard in self.shards[cell][:shards]), Seconds()) for cell in cells}
        episodes = {cell: [read_episode(line, labels) for line in self.lines(cell)[:num]] for cell in cells}
        tried = min(num, ORACLE_EPISODES)
        solved = {
            t: [json.loads(line)["solved"] for line in self.lines((ORACLE, t))[:tried]] for t in selection.targets
        }
        bounds = {t: json.loads(line) for t in selection.targets if bound for line in self.lines((BOUND, t))}
        found = compare_episodes(
            *(problem, episodes, seconds, solved, reference, np.random.default_rng(seed)),
            {target: some["bound"] for target, some in bounds.items()},
        )
        return replace(
            found, revealed_body=RevealedBody.over_targets([some["revealed_body"] for some in bounds.values()])
        )

    def _has_oracle(self, target: str, num: int) -> bool:
        return len(self.lines((ORACLE, target))) >= min(num, ORACLE_EPISODES)


def _in_turn(folder: RunFolder, decider: str, target: str, digest: str) -> Iterator[Shard]:
    """Yield shards from the first up to one that is missing, of another digest, or not full."""
    number = 0
    while (shard := folder.read(key := ShardKey(decider, target, number))) and shard.made_by == digest:
        yield shard
        if len(shard.lines) < key.most or decider == BOUND:
            return
        number += 1
