"""``activetouch merge``: folders that several machines filled become one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from belief.errors import ActiveTouchError
from experiments.results import RunFolder, RunMismatch, ShardKey


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
        activetouch compare --scene coarse --out runs/both                (the report; plays what is missing)
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of runs."""
    out: Path = Path("runs/merged")
    """Folder to unite them in."""

    def run(self) -> None:
        """Merge and say what there is now."""
        keys = merge(self.folders, self.out)
        for decider in sorted({key.decider for key in keys if key.is_played}):
            shards = [key for key in keys if key.decider == decider]
            targets = sorted({key.target for key in shards})
            print(f"{decider}: {sum(len(key.episodes) for key in shards)} episodes of {', '.join(targets)}")
        print(f"{self.out} holds all of them; for the report: activetouch compare ... --out {self.out}")


def merge(sources: Sequence[Path], out: Path) -> list[ShardKey]:
    """Copy all whole shards of run folders into one, and write its ``run.json`` and ``episodes.jsonl``.

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
    united = RunFolder(out)
    if (out / "run.json").exists():
        runs.append(united.read_run())
    for path, run in zip([*dict.fromkeys(sources), out], runs, strict=False):
        differing = sorted(key for key, value in runs[0]["identity"].items() if run["identity"].get(key) != value)
        if differing or run["identity"].keys() != runs[0]["identity"].keys():
            raise RunMismatch(
                f"{path} holds another run than {sources[0]}: other {', '.join(differing) or 'fields'}. Only runs of "
                "the same seed, scene, sensor and versions can be merged."
            )
    for folder in folders:
        for key in folder.complete_keys():
            lines = folder.lines(key)
            if not united.has(key):
                united.write(key, lines, folder.seconds(key))
            elif united.lines(key) != lines:
                raise Conflict(
                    f"{folder.path} and {out} hold different episodes {key.stem}, though their runs are the same. One "
                    "was changed, or played on another kind of processor; delete that shard."
                )
    keys = united.complete_keys()
    united.write_run({**runs[0], "arguments": _arguments([run["arguments"] for run in runs], keys)})
    united.write_episodes(line for key in keys if key.is_played for line in united.lines(key))
    return keys


def _arguments(arguments: Sequence[dict[str, Any]], keys: Sequence[ShardKey]) -> dict[str, Any]:
    """Those of the first, and who searches for what in any."""
    played = [key for key in keys if key.is_played]
    return {
        **arguments[0],
        "deciders": list(dict.fromkeys(key.decider for key in played)),
        "targets": list(dict.fromkeys(key.target for key in played)),
        "part": "1/1",
    }
