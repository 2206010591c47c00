"""Compare recorded outcomes of anybody's episodes: CSV files with seed, task and success, and no scene.

Episodes of the same task and seed are pairs.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from belief.files import plain_number, require_regular_file
from belief.statistics import wilson_interval
from belief.table import Table, Value
from experiments.command_line.arguments import BadArgument
from experiments.reporting.page import Section, write_page
from experiments.search.summary import ALL, Difference, differences
from experiments.search.verdict import success_sentence

NEEDED = ("seed", "task", "success")
"""Columns of a CSV file; ``length`` is optional, and others are ignored."""
_TRUTH = {"1": True, "1.0": True, "true": True, "yes": True, "0": False, "0.0": False, "false": False, "no": False}
Key: TypeAlias = tuple[str, str]
"""Task and seed of an episode."""


@dataclass(frozen=True, eq=False)
class ResultsComparison:
    """Success of several policies on the same episodes, and their differences.

    Attributes:
        keys: task and seed of the N episodes that are in all files, in the order of the first.
        success: by policy, ``(N,)``.
        length: steps or touches by policy, ``(N,)``; NaN where a file does not state it.
        left_out: number of episodes of each policy that are not in all files.
        differences: every other policy minus the reference, over all tasks.
        reference: policy that the others are compared with.
    """

    keys: Sequence[Key]
    success: Mapping[str, NDArray[np.bool_]]
    length: Mapping[str, NDArray[np.float64]]
    left_out: Mapping[str, int]
    differences: Mapping[str, Difference]
    reference: str

    def verdict(self) -> list[str]:
        """Sentences: what was paired, and which differences are significant."""
        number = len({task for task, _ in self.keys})
        said = [f"{len(self.keys)} episodes are in all files, of {number} task{'s'[: number > 1]}."]
        said += [
            f"{number} episodes of {name} are not in all others; left out."
            for name, number in self.left_out.items()
            if number
        ]
        return [*said, *(f"{success_sentence(name, self.reference, d)}." for name, d in self.differences.items())]

    def tables(self) -> list[Table]:
        """Success of every file by task, and differences from the reference."""
        tasks = np.array([task for task, _ in self.keys])
        groups = {task: tasks == task for task in dict.fromkeys(tasks.tolist())}
        groups = {**(groups if len(groups) > 1 else {}), ALL: np.ones(len(tasks), bool)}
        rates: list[Sequence[Value]] = []
        for name, success in self.success.items():
            for task, rows in groups.items():
                right, steps = success[rows], self.length[name][rows]
                wilson, length = wilson_interval(int(right.sum()), len(right)), float(steps.mean())
                mean = None if math.isnan(length) else length
                rates.append((name, task, len(right), float(right.mean()), wilson, mean))
        pairs = [
            (
                *(name, d.success[0], d.success[1:], d.mcnemar.first_only, d.mcnemar.second_only, d.p_value),
                *(d.episodes_for_success, *((None, None) if d.touches is None else (d.touches[0], d.touches[1:]))),
            )
            for name, d in self.differences.items()
        ]
        return [
            Table(
                "Success",
                [*("policy", ("task", ""), ("episodes", "d"), ("success", ".3f"), ("95 %", ".3f"), ("length", ".2f"))],
                rates,
                "Wilson intervals.",
                "success",
            ),
            Table(
                f"Difference from {self.reference} on the same episodes",
                [
                    *("policy", ("success", "+.3f"), ("95 %", "+.3f"), ("only this succeeds", "d")),
                    *(("only the other", "d"), ("p", ".2g"), ("episodes needed", ",d"), ("length", "+.2f")),
                    ("95 % ", "+.2f"),
                ],
                pairs,
                "Means with 95 % bootstrap intervals over pairs. p: McNemar's test (mid-p), corrected by Holm for the "
                "number of policies. Episodes needed: at which this test detects a difference of the observed size "
                "with 80 % power.",
                "differences",
            ),
        ]

    def save(self, folder: Path) -> Path:
        """Write ``report.html`` and the tables as CSV; return the path of the page.

        Raises:
            CannotWrite: the disk is full, or the folder is not writable.
        """
        tables = [table for table in self.tables() if table.rows]
        for table in tables:
            table.write_csv(folder / "tables" / f"{table.name}.csv")
        sections = [Section("Verdict", self.verdict()), Section("Tables", (), tables)]
        write_page(folder / "report.html", f"Results of {', '.join(self.success)}", sections)
        return folder / "report.html"


def compare_results(files: Sequence[Path], reference: str | None = None, seed: int = 0) -> ResultsComparison:
    """Read and compare files with the columns :data:`NEEDED`.

    A file is called by its name without ending, or by its folder and name if several are called alike.

    Args:
        files: CSV files, one for each policy.
        reference: name of the policy that the others are compared with; the first by default.
        seed: of the bootstraps.

    Raises:
        BadArgument: a file cannot be read, lacks a column, or states an episode twice; no episode is in all files; or
            names repeat.
    """
    alike = Counter(path.stem for path in files)
    names = [path.stem if alike[path.stem] == 1 else str(path.with_suffix("")) for path in files]
    if not names or len({*names}) < len(names):
        raise BadArgument(f"--results must name different files, one or more; got {', '.join(names) or 'none'}")
    if reference is not None and reference not in names:
        raise BadArgument(f"--reference must be one of {', '.join(names)}, got {reference!r}")
    every = {name: _read(path) for name, path in zip(names, files, strict=True)}
    first = next(iter(every.values()))
    keys = [key for key in first if all(key in one for one in every.values())]
    if not keys:
        told = "; ".join(f"{name}: {next(iter(one))}" for name, one in every.items())
        raise BadArgument(f"no episode of the same task and seed is in all files. The first of each is {told}")
    success = {name: np.array([one[key][0] for key in keys]) for name, one in every.items()}
    length = {name: np.array([one[key][1] for key in keys]) for name, one in every.items()}
    chosen = reference or names[0]
    found = differences(success, length, None, chosen, np.random.default_rng(seed))
    return ResultsComparison(
        keys, success, length, {name: len(one) - len(keys) for name, one in every.items()}, found, chosen
    )


def _read(path: Path) -> dict[Key, tuple[bool, float]]:
    """Success and length of the episodes of a file; the length is NaN where the file does not state it."""
    try:
        text = require_regular_file(path, BadArgument).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise BadArgument(f"{path} cannot be read as text: {error}") from error
    found: dict[Key, tuple[bool, float]] = {}
    try:
        for place, row in _rows(path, text):
            key = row["task"], row["seed"].removesuffix(".0")  # a table program may have made seeds floats
            if not key[1]:
                raise BadArgument(f"{path}, {place}: the seed is missing")
            if key[0] == ALL:
                raise BadArgument(f"{path}, {place}: a task cannot be called {ALL!r}, which stands for all of them")
            if key in found:
                raise BadArgument(
                    f"{path}, {place}: the episode of task {key[0]!r} with seed {key[1]!r} is there twice"
                )
            found[key] = _outcome(f"{path}, {place}", row["success"], row.get("length", ""))
    except csv.Error as error:
        raise BadArgument(f"{path} is not CSV: {error}") from error
    if not found:
        raise BadArgument(f"{path} holds no episodes")
    return found


def _rows(path: Path, text: str) -> Iterator[tuple[str, dict[str, str]]]:
    """The place of each row in the file, and its cells by column."""
    lines = csv.reader(io.StringIO(text, newline=""), strict=True)
    header = [name.strip().lower() for name in next(lines, [])]
    if missing := [name for name in NEEDED if name not in header]:
        raise BadArgument(
            f"{path} has no column {' and no column '.join(map(repr, missing))}: it needs {', '.join(NEEDED)}, and may "
            f"have length; its first line is {','.join(header)[:200] or 'empty'}"
        )
    if twice := [name for name in (*NEEDED, "length") if header.count(name) > 1]:
        raise BadArgument(f"{path} has the column {twice[0]!r} {header.count(twice[0])} times")
    for cells in filter(None, lines):
        place = f"line {lines.line_num}"
        if len(cells) != len(header):
            raise BadArgument(f"{path}, {place}: {len(cells)} cells under {len(header)} columns")
        yield place, dict(zip(header, map(str.strip, cells), strict=True))


def _outcome(place: str, success: str, length: str) -> tuple[bool, float]:
    succeeded = _TRUTH.get(success.lower())
    if succeeded is None:
        raise BadArgument(f"{place}: success must be 1, 0, true or false, got {success[:40]!r}")
    try:
        steps = plain_number(length) if length else math.nan
    except ValueError:
        steps = -1.0
    if steps < 0.0 or steps > 1e12:
        raise BadArgument(f"{place}: length must be a number of steps, 0 or more, got {length[:40]!r}")
    return succeeded, steps
