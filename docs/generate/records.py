"""Keep the records of finished comparisons whose numbers the pages state: command, code, versions, results.

Run: python docs/generate/records.py FOLDER ...        (folders that `activetouch compare` wrote; one record per sensor)

Runs of one sensor that differ in their seed only are pooled. A test compares README and docs/results.md with these
records.
"""

from __future__ import annotations

import csv
import json
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from belief.statistics import wilson_interval
from experiments.search.compare import Compare

RECORDS = Path(__file__).parent.parent.parent / "records" / "results" / "searches.json"
IN_COMMAND = {"scene", "sensor", "deciders", "episodes", "seed"}
FREE = IN_COMMAND | {"reference", "jobs"}
"""Arguments that a record may have in any form: its command has them, or they change no result."""


def record(folder: Path) -> dict[str, Any]:
    """What a run folder found, over all targets, and what made it."""
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    arguments, identity = run["arguments"], run["identity"]
    setting = arguments["setting"]
    if changed := list(_changed(arguments, json.loads(json.dumps(asdict(Compare()), default=str)))):
        raise SystemExit(f"no record of {folder}, because it was made with other settings: {', '.join(changed)}")
    sensor = setting["sensor"] or setting["choice"]["scene"]
    return {
        "command": f"activetouch compare --scene {setting['choice']['scene']} --sensor {Path(sensor).name} "
        f"--deciders {shlex.join(arguments['deciders'])} --episodes {arguments['episodes']} --seed {identity['seed']}",
        "commit": run["commit"],
        "versions": identity["versions"],
        "sensor_sha256": identity["sensor_sha256"],
        "deciders": {
            row["decider"]: {
                "searches": int(row["episodes"]),
                "success": [float(row[name]) for name in ("success", "success_low", "success_high")],
                "touches": float(row["touches"]),
                "return": float(row["return"]),
            }
            for row in _rows(folder, "results")
            if row["target"] == "all"
        },
    }


def pooled(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """One record of runs that differ in their seed only, with the command of the first.

    Raises:
        SystemExit: two runs differ in something else, or have the same seed.
    """
    commands = [one["command"].rpartition(" --seed ") for one in found]
    if any(one | _FREE != found[0] | _FREE for one in found) or len({words for words, _, _ in commands}) > 1:
        raise SystemExit(f"runs of different code, sensors or commands are not pooled: {[c for c, _, _ in commands]}")
    seeds = [int(seed) for _, _, seed in commands]
    if len(set(seeds)) < len(seeds):
        raise SystemExit(f"runs of one seed are not pooled, they hold the same searches; the seeds are {seeds}")
    return {**found[0], "seeds": seeds, "deciders": {name: _together(found, name) for name in found[0]["deciders"]}}


_FREE = {"command": None, "deciders": None}  # what pooled runs may differ in


def _together(found: Sequence[Mapping[str, Any]], decider: str) -> dict[str, Any]:
    """The numbers of a decider over all searches of some runs."""
    rows = [one["deciders"][decider] for one in found]
    searches = [row["searches"] for row in rows]
    total = sum(searches)
    won = sum(round(row["success"][0] * number) for row, number in zip(rows, searches, strict=True))
    means = {
        key: sum(row[key] * number for row, number in zip(rows, searches, strict=True)) / total
        for key in ("touches", "return")
    }
    return {
        "searches": total,
        "success": [won / total, *wilson_interval(won, total)],
        **means,
        "touches_by_seed": [row["touches"] for row in rows],
    }


def _changed(found: dict[str, Any], default: dict[str, Any]) -> Iterator[str]:
    """Names of the arguments that are not their default, nor in the command of a record, nor without effect."""
    for name, value in found.items():
        if isinstance(value, dict):
            yield from _changed(value, default[name])
        elif name not in FREE and value != default[name]:
            yield f"{name} {value}"


def _rows(folder: Path, table: str) -> list[dict[str, str]]:
    with (folder / "tables" / f"{table}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def main(folders: list[Path]) -> None:
    """Add or replace the records of these runs."""
    kept = json.loads(RECORDS.read_text(encoding="utf-8")) if RECORDS.exists() else {}
    of_sensor: dict[str, list[dict[str, Any]]] = {}
    for found in map(record, folders):
        words = found["command"].split()
        of_sensor.setdefault(words[words.index("--sensor") + 1], []).append(found)
    kept |= {sensor: pooled(some) for sensor, some in of_sensor.items()}
    text = json.dumps(dict(sorted(kept.items())), indent=1, ensure_ascii=False)
    RECORDS.write_text(f"{text}\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main([Path(word) for word in sys.argv[1:]])
