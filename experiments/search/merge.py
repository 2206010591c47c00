"""``activetouch merge``: folders that several machines filled become one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from belief.errors import ActiveTouchError
from experiments.command_line.arguments import BadArgument
from experiments.search.run_folder import BOUND, ORACLE, MadeBy, RunFolder, RunMismatch, ShardKey, united


class Conflict(ActiveTouchError, ValueError):
    """Two folders hold different episodes under one key, which the same run never plays."""


@dataclass(frozen=True)
class Merge:
    """Unite run folders of the same comparison: every shard once, whoever played it.

    Nothing is taken from a folder with another seed, scene, sensor or versions, and nothing that is not whole. The
    folders merged stay as they are; --out may be one of them.

    For example:

        activetouch compare --scene coarse --part 1/2 --out runs/a        (on one machine)
        activetouch compare --scene coarse --part 2/2 --out runs/b        (on another)
        activetouch merge runs/a runs/b --out runs/both
        activetouch compare --config runs/both/run.json                   (the report; plays what is missing)
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of runs."""
    out: Path = Path("runs/merged")
    """Folder to unite them in."""

    def run(self) -> None:
        """Merge and say what there is now."""
        if not self.folders:
            raise BadArgument(
                "merge needs folders of runs to unite, such as: activetouch merge runs/a runs/b --out runs/c"
            )
        keys = merge(self.folders, self.out)
        held = RunFolder(self.out)
        for decider in sorted({key.decider for key in keys if key.is_played}):
            shards = [key for key in keys if key.decider == decider]
            targets = sorted({key.target for key in shards})
            print(f"{decider}: {sum(len(held.lines(key)) for key in shards)} episodes of {', '.join(targets)}")
        print(f"{self.out} holds all of them; for the report:\n{held.again()}")


def merge(sources: Sequence[Path], out: Path) -> list[ShardKey]:
    """Copy all whole shards of run folders into one, and write its ``run.json`` and ``episodes.jsonl``.

    Of two shards of which one holds more episodes, that one counts. What a folder keeps of earlier versions of a
    decider stays where it is.

    Args:
        sources: at least one.
        out: may hold some of the same run already.

    Returns:
        Keys of all shards that are there now, those that ``out`` held before included.

    Raises:
        FileNotFoundError: a folder holds no run.
        RunMismatch: the runs are not the same one.
        Conflict: they are, and yet hold different episodes under one key.
        CannotWrite: the disk is full; what was copied is kept.
    """
    folders = [RunFolder(path) for path in dict.fromkeys(sources)]
    runs = [folder.read_run() for folder in folders]
    united_folder = RunFolder(out)
    if (out / "run.json").exists():
        runs.append(united_folder.read_run())
    for path, run in zip([*dict.fromkeys(sources), out], runs, strict=False):
        differing = sorted(key for key, value in runs[0]["identity"].items() if run["identity"].get(key) != value)
        if differing or run["identity"].keys() != runs[0]["identity"].keys():
            raise RunMismatch(
                f"{path} holds another run than {sources[0]}: other {', '.join(differing) or 'fields'}. Only runs of "
                "the same seed, scene, sensor and versions can be merged."
            )
    players: dict[str, dict[str, str]] = {}
    for path, run in zip([*dict.fromkeys(sources), out], runs, strict=False):
        _require_same_players(path, run["made_by"], players)
        players = united(players, run["made_by"])
    for folder in folders:
        for key in folder.complete_keys():
            theirs, ours = folder.read(key), united_folder.read(key)
            assert theirs is not None, "complete keys can be read"
            if ours is None or ours.made_by != theirs.made_by or len(ours.lines) < len(theirs.lines):
                united_folder.write(key, theirs)
            elif len(ours.lines) == len(theirs.lines) and ours.lines != theirs.lines:
                raise Conflict(
                    f"{folder.path} and {out} hold different episodes {key.stem}, though their runs are the same. One "
                    "was played on another kind of processor; delete that shard."
                )
    players = {name: dict(sorted(players[name].items())) for name in sorted(players)}
    told = {**runs[0], "made_by": players}
    arguments = {**_arguments([run["arguments"] for run in runs], players), "out": str(out)}
    united_folder.write_run({**told, "arguments": arguments})
    keys = united_folder.complete_keys()
    united_folder.write_episodes(line for key in keys if key.is_played for line in united_folder.lines(key))
    return keys


def _require_same_players(path: Path, theirs: MadeBy, ours: MadeBy) -> None:
    for decider, by_target in theirs.items():
        for target, digest in by_target.items():
            if ours.get(decider, {}).get(target, digest) != digest:
                raise Conflict(
                    f"{path} holds searches of {decider} for {target} that another version of it played (code, "
                    "settings or policies) than in the folders before it. Play them again there with the version you "
                    "mean, by the same command, and merge then."
                )


def _arguments(arguments: Sequence[dict[str, Any]], players: MadeBy) -> dict[str, Any]:
    """Those of the first, and who searches for what in any."""
    deciders = [name for name in players if name not in (ORACLE, BOUND)]
    targets = dict.fromkeys(target for name in deciders for target in players[name])
    return {**arguments[0], "deciders": deciders, "targets": list(targets), "part": "1/1"}
