"""``activetouch merge``: combine run folders of several machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from belief.errors import ActiveTouchError, CorruptFile
from experiments.command_line.arguments import BadArgument
from experiments.search.fingerprint import differing
from experiments.search.run_folder import BOUND, ORACLE, MadeBy, RunFolder, RunMismatch, ShardKey, united


class Conflict(ActiveTouchError, ValueError):
    """Two folders hold different episodes under the same shard key."""


@dataclass(frozen=True)
class Merge:
    """Combine run folders of the same comparison.

    All folders must have the same seed, scene, sensor and package versions. Damaged shards are skipped. The source
    folders do not change; --out may be one of them.

    For example:

        activetouch compare --scene coarse --part 1/2 --out runs/a        (on one machine)
        activetouch compare --scene coarse --part 2/2 --out runs/b        (on another)
        activetouch merge runs/a runs/b --out runs/both
        activetouch compare --config runs/both/run.json                   (runs what is missing; writes the report)
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Run folders to combine."""
    out: Path = Path("runs/merged")
    """Folder to write."""

    def run(self) -> None:
        """Merge the folders and print what the result holds."""
        if not self.folders:
            raise BadArgument("merge needs run folders, such as: activetouch merge runs/a runs/b --out runs/c")
        keys = merge(self.folders, self.out)
        held = RunFolder(self.out)
        for decider in sorted({key.decider for key in keys if key.is_played}):
            shards = [key for key in keys if key.decider == decider]
            targets = sorted({key.target for key in shards})
            print(f"{decider}: {sum(len(held.lines(key)) for key in shards)} episodes of {', '.join(targets)}")
        print(f"merged into {self.out}; for the report:\n{held.again()}")


def merge(sources: Sequence[Path], out: Path) -> list[ShardKey]:
    """Copy all intact shards of run folders into one, and write its ``run.json`` and ``episodes.jsonl``.

    Of two shards with the same key, the one with more episodes is kept. The run has the largest number of episodes of
    all, so that its report leaves none out. Shards of earlier versions of a decider are not copied.

    Args:
        sources: at least one run folder.
        out: folder to write; may already hold a part of the same run.

    Returns:
        Keys of all shards in ``out``.

    Raises:
        FileNotFoundError: A folder holds no run.
        RunMismatch: The folders hold different runs.
        Conflict: Two folders hold different episodes under the same key.
        CannotWrite: The disk is full; copied shards are kept.
    """
    folders, target_folder = [RunFolder(path) for path in dict.fromkeys(sources)], RunFolder(out)
    merged = [*folders, *([target_folder] if (out / "run.json").exists() else [])]
    runs = [folder.read_run() for folder in merged]
    players: dict[str, dict[str, str]] = {}
    for folder, run in zip(merged, runs, strict=True):
        first, own = runs[0]["identity"], run["identity"]
        if own != first:
            raise RunMismatch(
                f"{folder.path} holds another run than {sources[0]}: other {differing(first, own)}. Only runs of the "
                "same seed, scene, sensor and versions can be merged"
            )
        _require_same_players(folder.path, run["made_by"], players)
        players = united(players, run["made_by"])
    players = {name: dict(sorted(players[name].items())) for name in sorted(players)}
    deciders = [name for name in players if name not in (ORACLE, BOUND)]
    targets = list(dict.fromkeys(target for name in deciders for target in players[name]))
    episodes = max(_episodes(folder, run) for folder, run in zip(merged, runs, strict=True))
    changes = {"deciders": deciders, "targets": targets, "episodes": episodes, "part": "1/1", "out": str(out)}
    # Before the first shard: without it, an interrupted merge leaves shards that any other run would take as its own.
    changed = {"made_by": players, "arguments": {**runs[0]["arguments"], **changes}}
    target_folder.write_run({**runs[0], **changed, "format": min(run["format"] for run in runs)})
    for folder in folders:
        folder.tell_foreign()
        for key in folder.complete_keys():
            theirs, ours = folder.read(key), target_folder.read(key)
            assert theirs is not None, "complete keys can be read"
            if ours is None or ours.made_by != theirs.made_by or len(ours.lines) < len(theirs.lines):
                target_folder.write(key, theirs)
            elif len(ours.lines) == len(theirs.lines) and ours.lines != theirs.lines:
                raise Conflict(
                    f"{folder.path} and {out} hold different episodes in shard {key.stem} of the same run, probably "
                    "because different kinds of processors played them; delete one of the two shards"
                )
    keys = target_folder.complete_keys()
    target_folder.write_episodes(line for key in keys if key.is_played for line in target_folder.lines(key))
    return keys


def _episodes(folder: RunFolder, run: Mapping[str, Any]) -> int:
    episodes = run["arguments"].get("episodes")
    if not isinstance(episodes, int):
        raise CorruptFile(f"{folder.path / 'run.json'} is damaged: its number of episodes is {episodes!r:.80}")
    return episodes


def _require_same_players(path: Path, theirs: MadeBy, ours: MadeBy) -> None:
    for decider, by_target in theirs.items():
        for target, digest in by_target.items():
            if ours.get(decider, {}).get(target, digest) != digest:
                raise Conflict(
                    f"{path} holds searches of {decider} for {target} that another version of this decider played "
                    "(code, settings or policies) than in the folders before it. Repeat the command that filled "
                    f"{path} with the current version, then merge again"
                )
