"""Resume of a comparison: find the shards that a run folder lacks, and play only those."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from experiments.parallel import run_lazily
from experiments.search.holdings import ORACLE_EPISODES
from experiments.search.run_folder import BOUND, EPISODES_PER_SHARD, ORACLE, MadeBy, RunFolder, ShardKey
from experiments.search.setting import Setting
from experiments.search.shards import ShardTask, identity, portrait


def shard_sizes(players: Sequence[str], targets: Sequence[str], episodes: int) -> dict[ShardKey, int]:
    """Every shard of a comparison, and how many lines it must have; the last shard of a cell may be partly filled.

    Args:
        players: names of deciders, or of the full-information oracle or the bound.
        targets: labels of the shapes sought.
        episodes: searches for each decider and target.

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
    """Play the shards that a folder lacks, or that another version played; keep all others.

    ``run.json`` is written when the first shard is there, and at the end if no shard was missing.

    Args:
        folder: of the run.
        setting: what the episodes have in common, resolved.
        seed: of the run.
        sizes: every shard of the comparison and its number of lines; see :func:`shard_sizes`.
        arguments: of the command, for ``run.json``.
        part: number of this part, from 0, and the number of parts.
        jobs: processes of this machine.
        scheduler: address of a Dask scheduler, to play on its workers instead.

    Raises:
        RunMismatch: The folder holds another run.
        CannotWrite: The disk is full, or the folder cannot be written to.
        NoCluster: There is no cluster at this address.
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
    _report_outdated(folder, sizes, players)

    def done(key: ShardKey) -> bool:
        return folder.has(key, players[key.decider][key.target], sizes[key])

    keys = [key for key in list(sizes)[first::parts] if not done(key)]
    # In random order: of several processes that fill one folder, each then finds most shards of the others done.
    np.random.default_rng().shuffle(keys)

    def missing() -> Iterator[ShardTask]:
        return (
            ShardTask(key, sizes[key], setting, seed, wanted[key.decider, key.target]) for key in keys if not done(key)
        )

    def begin() -> None:
        warning = folder.open(run, arguments, players)
        if warning:
            print(warning, file=sys.stderr)

    opened = False
    for key, shard in run_lazily(missing(), len(keys), jobs, "searching", scheduler):
        if not opened:  # run.json is written only when there is a result: a run that fails claims no folder
            begin()
            opened = True
        if not done(key):
            folder.write(key, shard)
    if not opened:
        begin()


def _report_outdated(folder: RunFolder, sizes: Mapping[ShardKey, int], players: MadeBy) -> None:
    """Print to stderr which shards are played again because the decider that played them has changed."""
    outdated = [
        key.decider
        for key in sizes
        if (shard := folder.read(key)) is not None and shard.made_by != players[key.decider][key.target]
    ]
    if outdated:
        counts = ", ".join(f"{outdated.count(name)} of {name}" for name in dict.fromkeys(outdated))
        print(
            f"{folder.path} has shards that another version played, by code, settings or policies: {counts}; they are "
            "played anew",
            file=sys.stderr,
        )
