"""Resume of a comparison: play only the shards that its run folder lacks."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from experiments.parallel import run_lazily
from experiments.search.holdings import ORACLE_EPISODES
from experiments.search.run_folder import BOUND, EPISODES_PER_SHARD, ORACLE, MadeBy, RunFolder, ShardKey
from experiments.search.setting import Setting
from experiments.search.shards import GroupTask, ShardTask, identity, portrait


def shard_sizes(players: Sequence[str], targets: Sequence[str], episodes: int) -> dict[ShardKey, int]:
    """All shards of a comparison, with the number of lines of each.

    Args:
        players: names of deciders, or :data:`ORACLE` or :data:`BOUND`.
        targets: labels of the target shapes.
        episodes: searches per decider and target.

    >>> {key.stem: size for key, size in shard_sizes(["threshold"], ["cone"], 30).items()}
    {'threshold-cone-00000': 25, 'threshold-cone-00001': 5}
    """
    sizes = {}
    for player in players:
        num = {ORACLE: min(episodes, ORACLE_EPISODES), BOUND: 1}.get(player, episodes)
        for target in targets:
            for number in range(-(-num // EPISODES_PER_SHARD)):
                left = num - number * EPISODES_PER_SHARD
                sizes[ShardKey(player, target, number)] = min(left, EPISODES_PER_SHARD)
    return sizes


def groups_of(keys: Iterable[ShardKey], least: int = 1) -> list[list[ShardKey]]:
    """The shards that one process plays, because they share touches: those of the same episodes, the oracle's first.

    Args:
        keys: of the shards.
        least: number of groups wanted; where there are fewer, shards of the same episodes are spread over several.

    >>> keys = shard_sizes(["threshold", ORACLE], ["cone", "cube"], 25)
    >>> [[key.stem for key in group] for group in groups_of(keys)][0]
    ['oracle-cone-00000', 'threshold-cone-00000']
    >>> len(groups_of(keys, least=3))
    4
    """
    groups: dict[object, list[ShardKey]] = {}
    for key in sorted(keys, key=lambda key: key.decider != ORACLE):
        groups.setdefault(key if key.decider == BOUND else (key.target, key.number), []).append(key)
    pieces = -(-least // max(len(groups), 1))
    return [part for group in groups.values() for first in range(pieces) if (part := group[first::pieces])]


def play_missing(
    folder: RunFolder,
    setting: Setting,
    seed: int,
    sizes: Mapping[ShardKey, int],
    arguments: Mapping[str, object],
    part: tuple[int, int] = (0, 1),
    jobs: int = 1,
    scheduler: str | None = None,
) -> None:
    """Play the shards that a folder lacks or that another version of a decider played; keep all others.

    ``run.json`` is written together with the first shard, and again at the end: another process that plays other
    deciders may have written it at the same moment.

    Args:
        folder: folder of the run.
        setting: setting of all episodes, resolved.
        seed: seed of the run.
        sizes: number of lines of every shard; see :func:`shard_sizes`.
        arguments: arguments of the command, for ``run.json``.
        part: index of this part, from 0, and number of parts.
        jobs: number of processes on this machine.
        scheduler: address of a Dask scheduler whose workers play the shards instead.

    Raises:
        RunMismatch: The folder holds another run.
        CannotWrite: The disk is full, or the folder is not writable.
        NoCluster: The cluster cannot be reached.
        WorkerMismatch: A worker has other versions, another sensor or other code.
    """
    first, parts = part
    run = dict(identity(setting, seed))
    folder.require(run)
    cells = dict.fromkeys((key.decider, key.target) for key in sizes)
    wanted = {(decider, target): portrait(setting, seed, decider, target) for decider, target in cells}
    players: dict[str, dict[str, str]] = {}
    for (decider, target), text in wanted.items():
        players.setdefault(decider, {})[target] = str(json.loads(text)["decider"])
    folder.tell_foreign()
    _report_outdated(folder, sizes, players)

    def done(key: ShardKey) -> bool:
        return folder.has(key, players[key.decider][key.target], sizes[key])

    mine = chain.from_iterable(groups_of(sizes, parts)[first::parts])
    groups = groups_of((key for key in mine if not done(key)), 2 * jobs)
    order = np.random.default_rng().permutation(len(groups))
    # At random, so that processes that fill the same folder rarely play the same shards.

    def missing() -> Iterator[GroupTask]:
        for number in order:
            keys = [key for key in groups[number] if not done(key)]
            if keys:
                tasks = (ShardTask(key, sizes[key], setting, seed, wanted[key.decider, key.target]) for key in keys)
                yield GroupTask(tuple(tasks))

    is_open = False
    played = chain.from_iterable(run_lazily(missing(), len(groups), jobs, "searching", scheduler))
    for result in chain(played, [None]):
        # Not before the first result: a run that fails without any must not claim the folder.
        if not is_open or result is None:
            is_open = True
            if warning := folder.open(run, arguments, players):
                print(warning, file=sys.stderr)
        if result is not None and not done(result[0]):
            folder.write(*result)


def _report_outdated(folder: RunFolder, sizes: Mapping[ShardKey, int], players: MadeBy) -> None:
    """Print to stderr which shards will be replaced because their decider has changed."""
    outdated = [
        key.decider
        for key in sizes
        if (shard := folder.read(key)) is not None and shard.made_by != players[key.decider][key.target]
    ]
    if outdated:
        counts = ", ".join(f"{outdated.count(name)} of {name}" for name in dict.fromkeys(outdated))
        print(
            f"{folder.path} has shards of another version (code, settings or policies): {counts}; they are replaced",
            file=sys.stderr,
        )
