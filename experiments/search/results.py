"""Compare recorded outcomes of anybody's episodes: files with seed, task and success, and no scene; or finished runs.

Episodes of the same task and seed are pairs. A control is the same episodes without what is tested, such as without a
perturbation: a policy that fails without it, too, is not broken by it, so what counts is the policy minus its control.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from belief.columns import lines_of, read_columns
from belief.errors import InvalidArgument
from belief.files import plain_number
from belief.statistics import paired_bootstrap, wilson_interval
from belief.statistics.comparison import LEVEL
from belief.table import Table, Value
from experiments.command_line.arguments import BadArgument
from experiments.report import Report, Reported, Section
from experiments.search.run import RunFolder, read_episode
from experiments.search.summary import ALL, Difference, MeanInterval, Outcomes, differences
from experiments.search.verdict import success_sentence

NEEDED = ("seed", "task", "success")
"""Columns of a CSV file; ``length`` is optional, and others are ignored."""
_TRUTH = {"1": True, "1.0": True, "true": True, "yes": True, "0": False, "0.0": False, "false": False, "no": False}
Key: TypeAlias = tuple[str, str]
"""Task and seed of an episode; or policy and task of a difference."""
_Row: TypeAlias = tuple[str, dict[str, str]]
"""Place in a file, and cells by column."""


@dataclass(frozen=True, eq=False)
class ResultsComparison(Reported):
    """Success of several policies on the same episodes, their differences, and these minus controls.

    ``keys`` are task and seed of the N episodes that are in all files; ``success`` and ``length`` (NaN where a file
    does not state it) are by policy and by control, ``(N,)``. ``left_out`` counts the episodes of each file that are
    not in all; ``numbered`` names files without seeds, whose episodes are paired by their number within a task.
    ``control`` names the control of each policy. By (policy, task), with :data:`ALL` for all tasks together:
    ``differences`` from the ``reference``, every policy ``over_control``, and, where each has a control of its own,
    ``beyond_controls``, the difference before and after the controls are subtracted, with its 95 % bootstrap interval.
    """

    keys: Sequence[Key]
    success: Mapping[str, NDArray[np.bool_]]
    length: Mapping[str, NDArray[np.float64]]
    left_out: Mapping[str, int]
    numbered: Sequence[str]
    reference: str
    control: Mapping[str, str]
    differences: Mapping[Key, Difference]
    over_control: Mapping[Key, Difference]
    beyond_controls: Mapping[Key, tuple[float, MeanInterval]]

    def verdict(self) -> list[str]:
        """Sentences: how often each policy succeeds, what was paired, what is significant, what a control changes."""
        number, policies = (
            len({task for task, _ in self.keys}),
            [n for n in self.success if n not in {*self.control.values()}],
        )
        best, *others = sorted(policies, key=lambda name: -self.success[name].sum())
        rest = "".join(f"; {name} in {self.success[name].sum()}" for name in others)
        said = [f"{best} succeeds in {self.success[best].sum()} of {len(self.keys)} episodes{rest}."]
        said.append(f"{len(self.keys)} episodes are in all files, of {number} task{'s'[: number > 1]}.")
        said += [
            f"{number} episodes of {name} are not in all others; left out."
            for name, number in self.left_out.items()
            if number
        ]
        if self.numbered:
            said.append(
                f"Without seeds in {', '.join(self.numbered)}, episodes are paired by their number within a task, "
                "which is right if all runs began with the same seed."
            )
        other = dict.fromkeys(self.success, self.reference)
        for of, found in ((other, self.differences), (self.control, self.over_control)):
            said += [f"{success_sentence(name, of[name], d)}." for (name, task), d in found.items() if task == ALL]
        for name, control in self.control.items() if number > 1 else ():
            pairs = [d for (policy, task), d in self.over_control.items() if policy == name and task != ALL]
            right = [self.success[name][rows].all() for task, rows in _groups(self.keys).items() if task != ALL]
            failing = [d for d, is_right in zip(pairs, right, strict=True) if not is_right]
            no_worse = sum(d.success[0] >= 0.0 for d in failing)
            worse = sum(d.p_value < LEVEL and d.success[0] < 0.0 for d in failing)
            said.append(
                f"{name} fails in {len(failing)} of {number} tasks; minus {control} it is no worse in {no_worse} of "
                f"these, and significantly worse in {worse}."
            )
        for name in dict.fromkeys(policy for policy, _ in self.beyond_controls):
            rows = [
                before * after[0] < 0.0
                for (policy, task), (before, after) in self.beyond_controls.items()
                if policy == name and (task == ALL) is (number == 1)
            ]
            said.append(
                f"Subtracting the controls changes the sign of {name} minus {self.reference} in {sum(rows)} of "
                f"{number} task{'s'[: number > 1]}."
            )
        return said

    def tables(self) -> list[Table]:
        """Success of every file by task, differences from the reference, and differences from the controls."""
        rates: list[Sequence[Value]] = []
        for (name, success), (task, rows) in itertools.product(self.success.items(), _groups(self.keys).items()):
            right, length = success[rows], float(self.length[name][rows].mean())
            wilson, mean = wilson_interval(int(right.sum()), len(right)), None if math.isnan(length) else length
            rates.append((name, task, len(right), float(right.mean()), wilson, mean))
        after = [(*key, before, found[0], found[1:]) for key, (before, found) in self.beyond_controls.items()]
        return [
            Table(
                "Success",
                [*("policy", ("task", ""), ("episodes", "d"), ("success", ".3f"), ("95 %", ".3f"), ("length", ".2f"))],
                rates,
                "Wilson intervals.",
                "success",
            ),
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

    @staticmethod
    def of_all_tasks(rows: Sequence[Sequence[Value]]) -> Sequence[Sequence[Value]]:
        """Those rows of a table that are of all tasks together; all rows if there is one task."""
        return [row for row in rows if row[1] == ALL] or rows

    def report(self) -> Report:
        """The verdict and the tables that have rows."""
        tables = [table for table in self.tables() if table.rows]
        sections = [Section("Verdict", self.verdict()), Section("Tables", (), tables)]
        return Report(f"Results of {', '.join(self.success)}", sections, ("tables", "figures"))


def compare_results(
    files: Sequence[Path | str], reference: str | None = None, control: Sequence[Path | str] = (), seed: int = 0
) -> ResultsComparison:
    """Read and compare CSV files, or npz, with the columns :data:`NEEDED`, ``eval_info.json`` of LeRobot, or runs.

    A file is called by its name without ending, or by its folder and name if several are called alike. A run is as many
    policies as it has deciders, called as there; its seeds are the keys of its searches, and its tasks the targets. The
    others are compared with the ``reference``, the first by default. ``control`` are the same episodes without what is
    tested: none, one file for all policies, or one for each. The ``seed`` is of the bootstraps.
    """
    paths = [Path(file) for file in files]
    read = [(path, *column) for path in (*paths, *map(Path, control)) for column in _columns(path)]
    alike = Counter(name for _, name, *_ in read)
    places = [str(path.with_suffix("") if name == path.stem else path / name) for path, name, *_ in read]
    every = [name if alike[name] == 1 else place for place, (_, name, *_) in zip(places, read, strict=True)]
    number = sum(path in paths for path, *_ in read)
    names, controls = every[:number], every[number:]
    if not names:
        raise BadArgument("--results must name one file or more; --control alone has nothing to be subtracted from")
    if len({*every}) < len(every):
        raise BadArgument(f"--results and --control must name different files, got {', '.join(every)}")
    if reference is not None and reference not in names:
        raise BadArgument(f"--reference must be one of {', '.join(names)}, got {reference!r}")
    if len(controls) not in (0, 1, len(names)):
        raise BadArgument(f"--control takes one file for all, or one for each of {len(names)}; got {len(controls)}")
    found = dict(zip(every, (episodes for *_, episodes, _ in read), strict=True))
    numbered = [name for name, (*_, is_numbered) in zip(every, read, strict=True) if is_numbered]
    keys = [key for key in found[names[0]] if all(key in one for one in found.values())]
    if not keys:
        told = "; ".join(f"{name}: {next(iter(one))}" for name, one in found.items())
        raise BadArgument(f"no episode of the same task and seed is in all files. The first of each is {told}")
    success = {name: np.array([one[key][0] for key in keys]) for name, one in found.items()}
    length = {name: np.array([one[key][1] for key in keys]) for name, one in found.items()}
    left_out = {name: len(one) - len(keys) for name, one in found.items()}
    chosen, groups, rng = reference or names[0], _groups(keys), np.random.default_rng(seed)
    control_of = {name: controls[min(i, len(controls) - 1)] for i, name in enumerate(names) if controls}
    outcomes = {name: Outcomes(success[name], length[name], np.full(len(keys), np.nan)) for name in found}
    beside = differences({name: chosen for name in names if name != chosen}, outcomes, groups, rng)
    over = differences(control_of, outcomes, groups, rng)
    beyond = {}
    if len(controls) == len(names):
        gain = {name: success[name].astype(float) - success[control_of[name]] for name in names}
        for (name, task), one in beside.items():
            after = paired_bootstrap(gain[name][groups[task]], gain[chosen][groups[task]], rng)
            beyond[name, task] = one.success[0], after
    return ResultsComparison(keys, success, length, left_out, numbered, chosen, control_of, beside, over, beyond)


def _groups(keys: Sequence[Key]) -> dict[str, NDArray[np.bool_]]:
    """Which of the episodes are of each task, if there are several, and of all."""
    tasks = np.array([task for task, _ in keys])
    groups = {task: tasks == task for task in dict.fromkeys(tasks.tolist())}
    return {**(groups if len(groups) > 1 else {}), ALL: np.ones(len(tasks), bool)}


def _pairs_table(title: str, pairs: Mapping[Key, Difference], name: str) -> Table:
    rows = [(*key, *found.cells[:-2]) for key, found in pairs.items()]  # rewards are of searches alone
    return Table(
        title,
        [
            *("policy", ("task", ""), ("success", "+.3f"), ("95 %", "+.3f"), ("only this succeeds", "d")),
            *(("only the other", "d"), ("p", ".2g"), ("episodes needed", ",d"), ("length", "+.2f"), ("95 % ", "+.2f")),
        ],
        rows,
        "Means with 95 % bootstrap intervals over pairs. p: McNemar's test (mid-p), corrected by Holm for the number "
        "of policies, and for that of all rows of single tasks. Episodes needed: at which this test detects a "
        "difference of the observed size with 80 % power.",
        name,
    )


def _columns(path: Path) -> Iterator[tuple[str, dict[Key, tuple[bool, float]], bool]]:
    """Name, episodes and whether they are numbered, of a file or of each decider of a run."""
    if not path.exists():
        raise BadArgument(f"there is no file {path}")
    if path.is_dir() or path.name == "episodes.jsonl":
        for name, rows in _of_run(path if path.is_dir() else path.parent).items():
            yield name, _episodes(path, rows), False
        return
    is_lerobots = path.suffix.lower() == ".json"
    found, is_numbered = _of_lerobot(path) if is_lerobots else (_rows(path), False)
    yield path.stem, _episodes(path, found), is_numbered


def _of_run(folder: Path) -> dict[str, list[_Row]]:
    """Rows as of CSV by decider, of the latest comparison in a run folder."""
    run = RunFolder(folder)
    labels = tuple(name for name, _ in run.read_run()["identity"]["scene"]["shapes"]["entries"])
    found: dict[str, list[_Row]] = {}
    for (decider, target), lines in run.latest(labels).items():
        for one in (read_episode(line, labels) for line in lines):
            row = {"task": target, "seed": str(one.seed), "success": str(one.success), "length": str(one.num_touches)}
            found.setdefault(decider, []).append((f"{decider}, episode {one.seed}", row))
    return found


def _episodes(path: Path, rows: Iterable[_Row]) -> dict[Key, tuple[bool, float]]:
    """Success and length of the episodes of a file; a length not stated is NaN."""
    found: dict[Key, tuple[bool, float]] = {}
    try:
        for place, row in rows:
            seed = row["seed"].removesuffix(".0")  # a table program may have made seeds floats
            key = row["task"], re.sub(r"[\s,]+", ", ", seed.strip("()[] "))  # and a list or an array of a key
            if not key[1]:
                raise BadArgument(f"{path}, {place}: the seed is missing")
            if key[0] == ALL:
                raise BadArgument(f"{path}, {place}: a task cannot be called {ALL!r}, which stands for all of them")
            if key in found:
                raise BadArgument(
                    f"{path}, {place}: the episode of task {key[0]!r} with seed {key[1]!r} is there twice"
                )
            found[key] = _outcome(f"{path}, {place}", row["success"], row.get("length", ""))
    except InvalidArgument as error:
        raise BadArgument(f"{path}, {error}") from error
    if not found:
        raise BadArgument(f"{path} holds no episodes")
    return found


def _of_lerobot(path: Path) -> tuple[Iterable[_Row], bool]:
    """Rows as of CSV, and whether they are numbered: by task, as LeRobot writes today, or by episode, as until 2025."""
    try:
        info = json.loads("".join(lines_of(path, BadArgument)))
        if "per_task" in info:
            told = [(f"{one['task_group']} {one['task_id']}", one["metrics"]["successes"]) for one in info["per_task"]]
            rows = [(task, i, None, success) for task, some in told for i, success in enumerate(some)]
        else:
            rows = [("", one["episode_ix"], one.get("seed"), one["success"]) for one in info["per_episode"]]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BadArgument(
            f"{path} is no eval_info.json of LeRobot, which has per_task, a list of task_group, task_id and "
            f"metrics.successes, or per_episode, a list of episode_ix, seed and success: {error!r:.200}"
        ) from error
    is_numbered = all(seed is None for *_, seed, _ in rows)  # if only some are, these are refused
    found = []
    for task, number, stated, success in rows:
        seed = number if is_numbered else stated
        row = {"task": task, "seed": "" if seed is None else str(seed), "success": str(success)}
        found.append((f"episode {number}{' of ' if task else ''}{task}", row))
    return found, is_numbered


def _rows(path: Path) -> Iterator[_Row]:
    """The place of each row in the file, and its cells by column."""
    names = (*NEEDED, "length")
    found = read_columns([path], names, BadArgument, needed=NEEDED, is_case_kept=False)
    if len({column.shape for column in found.arrays.values()}) > 1 or found.arrays["seed"].ndim != 1:
        raise BadArgument(f"{path}: {', '.join(found.arrays)} must be rows of one length")
    for row, cells in enumerate(zip(*found.arrays.values(), strict=True)):
        place = f"line {found.places[0][row]}" if found.places[0] else f"row {row}"
        yield place, dict(zip(found.arrays, map(str, cells), strict=True))


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
