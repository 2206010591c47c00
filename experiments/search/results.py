"""Compare recorded outcomes of anybody's episodes: files with seed, task and success, and no scene.

Episodes of the same task and seed are pairs. A control is the same episodes without what is tested, such as without a
perturbation: a policy that fails without it, too, is not broken by it, so what counts is the policy minus its control.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.files import plain_number, require_regular_file
from belief.statistics import McNemar, mcnemar_test, paired_bootstrap, wilson_interval
from belief.statistics.power import LEVEL, episodes_for_success, holm
from belief.table import Table, Value, interval
from experiments.command_line.arguments import BadArgument
from experiments.reporting.page import Section, write_page
from experiments.search.summary import ALL

NEEDED = ("seed", "task", "success")
"""Columns of a CSV file; ``length`` is optional, and others are ignored."""
_TRUTH = {"1": True, "1.0": True, "true": True, "yes": True, "0": False, "0.0": False, "false": False, "no": False}
Key = tuple[str, str]
Interval = tuple[float, float, float]


@dataclass(frozen=True)
class Results:
    """Outcomes of the episodes of one policy.

    Attributes:
        name: what it is called in the report.
        success: whether the episode succeeded, by (task, seed).
        length: number of steps or touches, by (task, seed); NaN where the file does not state it.
        is_numbered: whether the file states no seeds, so that the number of an episode within its task stands for it.
    """

    name: str
    success: Mapping[Key, bool]
    length: Mapping[Key, float]
    is_numbered: bool = False

    @classmethod
    def read(cls, path: Path, name: str | None = None) -> Results:
        """Read a CSV file with the columns :data:`NEEDED`, or the ``eval_info.json`` of LeRobot.

        Args:
            path: the file; an ending of ``.json`` means that of LeRobot.
            name: by default, the name of the file without its ending.

        Raises:
            BadArgument: the file cannot be read, lacks a column, or states an episode twice.
        """
        try:
            text = require_regular_file(path, BadArgument).read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise BadArgument(f"{path} cannot be read as text: {error}") from error
        is_json = path.suffix.lower() == ".json"
        success: dict[Key, bool] = {}
        length: dict[Key, float] = {}
        try:
            rows = list((_of_lerobot if is_json else _of_csv)(path, text))
        except csv.Error as error:
            raise BadArgument(f"{path} is not CSV: {error}") from error
        is_numbered = {seed is None for _, _, seed, _, _ in rows}
        if len(is_numbered) != 1:
            told = "states the seeds of some episodes and not of others; name all or none"
            raise BadArgument(f"{path} {told if rows else 'holds no episodes'}")
        numbers = Counter[str]()
        for place, task, seed, succeeded, steps in rows:
            key = (task, str(numbers[task]) if seed is None else seed)
            numbers[task] += 1
            if key in success:
                raise BadArgument(f"{path}, {place}: the episode of task {task!r} with seed {key[1]!r} is there twice")
            success[key], length[key] = succeeded, steps
        return cls(path.stem if name is None else name, success, length, is_numbered == {True})


Row = tuple[str, str, str | None, bool, float]  # place in the file, task, seed, success, length


def _of_csv(path: Path, text: str) -> Iterator[Row]:
    lines = csv.reader(io.StringIO(text, newline=""), strict=True)
    header = [name.strip().lower() for name in next(lines, [])]
    missing = [name for name in NEEDED if name not in header]
    if missing:
        raise BadArgument(
            f"{path} has no column {' and no column '.join(map(repr, missing))}: it needs {', '.join(NEEDED)}, and may "
            f"have length; its first line is {','.join(header)[:200] or 'empty'}"
        )
    twice = [name for name in (*NEEDED, "length") if header.count(name) > 1]
    if twice:
        raise BadArgument(f"{path} has the column {twice[0]!r} {header.count(twice[0])} times")
    for cells in lines:
        place = f"line {lines.line_num}"
        if not cells:
            continue
        if len(cells) != len(header):
            raise BadArgument(f"{path}, {place}: {len(cells)} cells under {len(header)} columns")
        found = dict(zip(header, map(str.strip, cells), strict=True))
        yield place, found["task"], _seed(found["seed"]), *_outcome(path, place, found["success"], found.get("length"))


def _of_lerobot(path: Path, text: str) -> Iterator[Row]:
    """Per task, as LeRobot writes it today, without seeds; or per episode, as it wrote it until 2025."""
    try:
        info = json.loads(text)
        if "per_task" in info:
            for one in info["per_task"]:
                task = f"{one['task_group']} {one['task_id']}"
                for number, success in enumerate(one["metrics"]["successes"]):
                    place = f"success {number} of {task}"
                    yield place, task, None, *_outcome(path, place, success, None)
            return
        for one in info["per_episode"]:
            place = f"episode {one['episode_ix']}"
            yield place, "", _seed(one.get("seed")), *_outcome(path, place, one["success"], None)
    except BadArgument:
        raise
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise BadArgument(
            f"{path} is no eval_info.json of LeRobot, which has per_task, a list of task_group, task_id and "
            f"metrics.successes, or per_episode, a list of episode_ix, seed and success: {error!r:.200}"
        ) from error


def _seed(given: Any) -> str | None:
    """A seed as text; whole numbers are written alike, also if a table program made them floats."""
    text = "" if given is None else str(given).strip()
    return text[:-2] if text.endswith(".0") and text[:-2].isdecimal() else text or None


def _outcome(path: Path, place: str, success: Any, length: Any) -> tuple[bool, float]:
    succeeded = _TRUTH.get(str(success).lower())
    if succeeded is None:
        raise BadArgument(f"{path}, {place}: success must be 1, 0, true or false, got {str(success)[:40]!r}")
    try:
        steps = plain_number(length) if length else math.nan
    except ValueError:
        steps = -1.0
    if steps < 0.0 or steps > 1e12:
        raise BadArgument(f"{path}, {place}: length must be a number of steps, 0 or more, got {length[:40]!r}")
    return succeeded, steps


@dataclass(frozen=True)
class Pair:
    """A policy minus another on the same episodes.

    Attributes:
        first, second: their names.
        task: the task, or :data:`ALL`.
        success: mean difference in success and its 95 % bootstrap interval.
        length: the same for lengths; None where one is not stated.
        mcnemar: McNemar's test of the success rates.
        p_value: mid-p value of this test, corrected for the policies (Holm); over single tasks, for all rows.
    """

    first: str
    second: str
    task: str
    success: Interval
    length: Interval | None
    mcnemar: McNemar
    p_value: float

    def __str__(self) -> str:
        """A sentence."""
        either = (
            f"of {self.mcnemar.num_episodes} episodes, {self.mcnemar.first_only} succeed only with {self.first} and "
            f"{self.mcnemar.second_only} only with {self.second} (p {self.p_value:.2g}, difference "
            f"{interval(*self.success, spec='+.3f')})"
        )
        if self.p_value < LEVEL:
            more = "more" if self.success[0] > 0 else "less"
            return f"{self.first} succeeds significantly {more} often than {self.second}: {either}."
        needed = episodes_for_success(self.mcnemar)
        more = "" if needed is None else f" To show a difference of this size takes about {needed} episodes."
        return f"{self.first} and {self.second} do not differ significantly: {either}.{more}"


class ResultsComparison:
    """Success of several policies on the same episodes, their differences, and these minus controls.

    Args:
        arms: policies, with different names.
        reference: name of the policy that the others are compared with; the first by default.
        controls: none, one for all policies, or one for each.
        seed: of the bootstraps.

    Attributes:
        keys: (task, seed) of the episodes that are in all files, in the order of the first.
        tasks: the tasks of these.
        differences: every other policy minus the reference, by task if there are several, and over all.
        over_control: every policy minus its control, in the same way.

    Raises:
        BadArgument: no episode is in all files, names repeat, or the number of controls does not fit.
    """

    def __init__(
        self, arms: Sequence[Results], reference: str | None = None, controls: Sequence[Results] = (), seed: int = 0
    ) -> None:
        names = [arm.name for arm in arms]
        every = {one.name: one for one in (*arms, *controls)}
        if not arms or len(every) < len(arms) + len(controls):
            said = ", ".join(one.name for one in (*arms, *controls)) or "none"
            raise BadArgument(f"--results and --control must name different files, one or more; got {said}")
        if reference is not None and reference not in names:
            raise BadArgument(f"--reference must be one of {', '.join(names)}, got {reference!r}")
        if len(controls) not in (0, 1, len(arms)):
            raise BadArgument(f"--control takes one file for all, or one for each of {len(arms)}; got {len(controls)}")
        self.reference, self._every, self._seed = reference or names[0], every, seed
        self._control = {name: controls[min(i, len(controls) - 1)].name for i, name in enumerate(names) if controls}
        shared = set.intersection(*(set(one.success) for one in every.values()))
        if not shared:
            told = "; ".join(f"{name}: {next(iter(one.success))}" for name, one in every.items())
            raise BadArgument(f"no episode of the same task and seed is in all files. The first of each is {told}")
        self.keys = [key for key in arms[0].success if key in shared]
        self.tasks = list(dict.fromkeys(task for task, _ in self.keys))
        if ALL in self.tasks:
            raise BadArgument(f"a task cannot be called {ALL!r}, which stands for all of them")
        groups = {ALL: np.arange(len(self.keys))}
        if len(self.tasks) > 1:
            of = np.array([self.tasks.index(task) for task, _ in self.keys])
            groups = {task: np.flatnonzero(of == i) for i, task in enumerate(self.tasks)} | groups
        self._groups = groups
        self._success = {name: np.array([one.success[key] for key in self.keys]) for name, one in every.items()}
        self._length = {name: np.array([one.length[key] for key in self.keys]) for name, one in every.items()}
        self.differences = self._pairs([(name, self.reference) for name in names if name != self.reference])
        self.over_control = self._pairs(list(self._control.items()))

    def _pairs(self, of: Sequence[tuple[str, str]]) -> list[Pair]:
        rng, found = np.random.default_rng(self._seed), []
        for (one, other), (task, rows) in itertools.product(of, self._groups.items()):
            a, b = self._success[one][rows], self._success[other][rows]
            steps, others = self._length[one][rows], self._length[other][rows]
            length = paired_bootstrap(steps, others, rng) if np.isfinite(steps + others).all() else None
            test = mcnemar_test(a, b)
            found.append(Pair(one, other, task, paired_bootstrap(a, b, rng), length, test, test.mid_p_value))
        corrected: dict[int, float] = {}
        for together in (True, False):  # all tasks together are one question, each of them another
            some = [pair for pair in found if (pair.task == ALL) is together]
            corrected |= dict(zip(map(id, some), holm([pair.p_value for pair in some]), strict=True))
        return [replace(pair, p_value=corrected[id(pair)]) for pair in found]

    @cached_property
    def beyond_controls(self) -> list[tuple[str, str, float, Interval]]:
        """Differences from the reference before and after each policy's own control is subtracted, by task.

        Rows of policy, task, difference before, and difference after with its 95 % bootstrap interval; none unless
        every policy has a control of its own.
        """
        if len(set(self._control.values())) < 2:
            return []
        rng, rows = np.random.default_rng(self._seed), []
        over = {
            name: self._success[name].astype(float) - self._success[control] for name, control in self._control.items()
        }
        for pair in self.differences:
            group = self._groups[pair.task]
            after = paired_bootstrap(over[pair.first][group], over[self.reference][group], rng)
            rows.append((pair.first, pair.task, pair.success[0], after))
        return rows

    def verdict(self) -> list[str]:
        """Sentences: what was paired, significant differences, and what a control changes."""
        said = [f"{len(self.keys)} episodes are in all files, of {len(self.tasks)} task{'s'[: len(self.tasks) > 1]}."]
        for name, one in self._every.items():
            if len(one.success) > len(self.keys):
                said.append(f"{len(one.success) - len(self.keys)} episodes of {name} are not in all others; left out.")
        if numbered := [name for name, one in self._every.items() if one.is_numbered]:
            said.append(
                f"Without seeds in {', '.join(numbered)}, episodes are paired by their number within a task, which is "
                "right if all runs began with the same seed."
            )
        said += [str(pair) for pair in (*self.differences, *self.over_control) if pair.task == ALL]
        singles = [pair for pair in self.over_control if pair.task != ALL]
        for name in self._control if singles else ():
            failing = [pair for pair in singles if pair.first == name and not self._successes(name, pair.task).all()]
            no_worse = sum(pair.success[0] >= 0.0 for pair in failing)
            worse = sum(pair.p_value < LEVEL and pair.success[0] < 0.0 for pair in failing)
            said.append(
                f"{name} fails in {len(failing)} of {len(self.tasks)} tasks; minus {self._control[name]} it is no "
                f"worse in {no_worse} of these, and significantly worse in {worse}."
            )
        for name in dict.fromkeys(row[0] for row in self.beyond_controls):
            rows = [row for row in self.beyond_controls if row[0] == name and (row[1] != ALL or not singles)]
            turned = sum(before * after[0] < 0.0 for _, _, before, after in rows)
            said.append(
                f"Subtracting the controls changes the sign of {name} minus {self.reference} in {turned} of "
                f"{len(rows)} task{'s'[: len(rows) > 1]}."
            )
        return said

    def _successes(self, name: str, task: str) -> NDArray[np.bool_]:
        return self._success[name][self._groups[task]]

    def tables(self) -> list[Table]:
        """Success of every file, differences from the reference, and differences from the controls."""
        rates: list[tuple[Value, ...]] = []
        for name, (task, group) in itertools.product(self._every, self._groups.items()):
            right, steps = self._successes(name, task), self._length[name][group]
            most = wilson_interval(int(right.sum()), len(right))
            length = float(steps.mean()) if np.isfinite(steps).all() else None
            rates.append((name, task, len(right), float(right.mean()), most, length))
        columns = [*("policy", ("task", ""), ("episodes", "d"), ("success", ".3f"), ("95 %", ".3f")), ("length", ".2f")]
        after = [(name, task, before, found[0], found[1:]) for name, task, before, found in self.beyond_controls]
        return [
            Table("Success", columns, rates, "Wilson intervals.", "success"),
            _pairs_table(f"Difference from {self.reference} on the same episodes", self.differences, "differences"),
            _pairs_table("Difference from the control on the same episodes", self.over_control, "over_control"),
            Table(
                f"Difference from {self.reference} before and after the controls are subtracted",
                ["policy", ("task", ""), ("before", "+.3f"), ("after", "+.3f"), ("95 %", "+.3f")],
                after,
                "Each policy minus its own control, minus the same of the reference; bootstrap intervals over pairs.",
                "beyond_controls",
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
        write_page(folder / "report.html", f"Results of {', '.join(self._every)}", sections)
        return folder / "report.html"


def compare_results(
    files: Sequence[Path], reference: str | None = None, control: Sequence[Path] = (), seed: int = 0
) -> ResultsComparison:
    """Read and compare files; arguments and errors as :class:`ResultsComparison` and :meth:`Results.read`.

    A file is called by its name without ending, or by its folder and name if several are called alike.
    """
    paths = [*files, *control]
    alike = Counter(path.stem for path in paths)
    names = [path.stem if alike[path.stem] == 1 else str(path.with_suffix("")) for path in paths]
    every = [Results.read(path, name) for path, name in zip(paths, names, strict=True)]
    return ResultsComparison(every[: len(files)], reference, every[len(files) :], seed)


def _pairs_table(title: str, pairs: Sequence[Pair], name: str) -> Table:
    rows: list[tuple[Value, ...]] = []
    for pair in pairs:
        test, length = pair.mcnemar, (None, None) if pair.length is None else (pair.length[0], pair.length[1:])
        counts = (test.first_only, test.second_only, pair.p_value, episodes_for_success(test))
        rows.append((pair.first, pair.task, pair.success[0], pair.success[1:], *counts, *length))
    return Table(
        title,
        [
            *("policy", ("task", ""), ("success", "+.3f"), ("95 %", "+.3f"), ("only this succeeds", "d")),
            *(("only the other", "d"), ("p", ".2g"), ("episodes needed", ",d"), ("length", "+.2f"), ("95 % ", "+.2f")),
        ],
        rows,
        "Means with 95 % bootstrap intervals over pairs. p: McNemar's test (mid-p), corrected by Holm for the number "
        "of policies, and for that of all rows of single tasks. Episodes needed: at which this test, uncorrected, "
        "detects a difference of the observed size with 80 % power.",
        name,
    )
