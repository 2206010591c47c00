"""The tables of a comparison: for a page, and as CSV with every number in full."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TypeAlias

from experiments.reporting.csv_text import csv_text
from experiments.search.summary import Comparison

Value: TypeAlias = str | int | float | tuple[float, float] | None
ALL = "all"


@dataclass(frozen=True)
class Sheet:
    """A table.

    Attributes:
        name: of its file.
        title: above it.
        columns: headings, each with the format of its numbers, "" for words.
        rows: values; a pair is an interval, None is nothing to tell.
        note: below it.
        long: whether a page should fold it away.
    """

    name: str
    title: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[Value]]
    note: str = ""
    long: bool = False

    @property
    def headings(self) -> list[str]:
        """Of the columns."""
        return [heading for heading, _ in self.columns]

    def cells(self) -> list[list[str]]:
        """The rows as a reader sees them."""
        return [[_show(value, spec) for value, (_, spec) in zip(row, self.columns, strict=True)] for row in self.rows]

    def csv(self) -> str:
        """The rows for a machine: intervals in two columns, numbers to the last digit, empty where there is nothing."""
        pairs = [any(isinstance(row[column], tuple) for row in self.rows) for column in range(len(self.columns))]
        headings = [[f"{h} low", f"{h} high"] if pair else [h] for h, pair in zip(self.headings, pairs, strict=True)]
        rows = [chain.from_iterable(headings)]
        for row in self.rows:
            values = [
                (value if isinstance(value, tuple) else ("", "")) if pair else ("" if value is None else value,)
                for value, pair in zip(row, pairs, strict=True)
            ]
            rows.append(chain.from_iterable(values))
        return csv_text(map(tuple, rows))


def _show(value: Value, spec: str) -> str:
    if value is None:
        return "–"
    if isinstance(value, tuple):
        return f"{value[0]:{spec}} … {value[1]:{spec}}"
    return f"{value:{spec}}"


def sheets(comparison: Comparison) -> list[Sheet]:
    """All tables of a comparison."""
    return [
        results(comparison),
        differences(comparison),
        returns(comparison),
        positions(comparison),
        promises(comparison),
        claims(comparison),
        touches(comparison),
        times(comparison),
    ]


def results(comparison: Comparison) -> Sheet:
    """Success and touches by decider and target."""
    rows = []
    for decider in comparison.deciders:
        for target in [*comparison.targets, ALL]:
            cell = comparison.cells[decider, target]
            counts = (cell.wrong, cell.none, cell.truncated)
            touched = (cell.touches, *cell.touch_quantiles)
            rows.append((decider, target, cell.num_episodes, cell.success, cell.success_interval, *counts, *touched))
    return Sheet(
        "results",
        "Success by target",
        [
            *(("decider", ""), ("target", ""), ("searches", "d"), ("success", ".3f"), ("95 %", ".3f")),
            *(("wrong", "d"), ("none", "d"), ("cut off", "d")),
            *(("touches", ".2f"), ("half ≤", "d"), ("90 % ≤", "d"), ("most", "d")),
        ],
        rows,
        "Wilson intervals. Wrong: another object was confirmed; none: every object was rejected though the target was "
        "there; cut off: the touch limit was reached.",
    )


def differences(comparison: Comparison) -> Sheet:
    """Every decider against the reference."""
    rows = [
        (
            *(name, d.success[0], d.success[1:], d.mcnemar.first_only, d.mcnemar.second_only, d.p_value),
            *(d.episodes_for_success, d.touches[0], d.touches[1:], d.reward[0], d.reward[1:]),
        )
        for name, d in comparison.differences.items()
    ]
    return Sheet(
        "differences",
        f"Against {comparison.reference}, on the same episodes",
        [
            *(("decider", ""), ("success", "+.3f"), ("95 % ", "+.3f")),
            *(("alone right", "d"), ("reference alone", "d"), ("p", ".2g"), ("would settle", ",d")),
            *(("touches", "+.2f"), ("95 %  ", "+.2f"), ("return", "+.3f"), ("95 %   ", "+.3f")),
        ],
        rows,
        "Mean differences with 95 % bootstrap intervals over pairs. p: McNemar's test (mid-p), corrected by Holm for "
        "the number of deciders. Would settle: searches per decider, in all, after which that test finds a difference "
        "as large as this one four times in five.",
    )


def returns(comparison: Comparison) -> Sheet:
    """Return, regret and the chance of being best."""
    rows = []
    for name, (mean, *interval) in comparison.regret.items():
        gap = comparison.gap[name]
        to_bound = (None, None) if gap is None else (gap[0], gap[1:])
        own = (name, comparison.cells[name, ALL].reward, comparison.prob_best[name])
        rows.append((*own, mean, tuple(interval), *to_bound))
    return Sheet(
        "returns",
        "Return, and what is missing to the ceiling",
        [
            *(("decider", ""), ("return", ".3f"), ("P(best)", ".3f"), ("regret", ".3f"), ("95 %", ".3f")),
            *(("to bound", ".3f"), ("95 % ", ".3f")),
        ],
        rows,
        f"Return: +1 for success, −1 else, less {comparison.problem.touch_cost:g} a touch. P(best): share of bootstrap "
        "resamples of the episodes in which the mean return is the highest. Regret: to the return of a reader that "
        f"touches every object in every pose for nothing before it answers, on the {comparison.ceiling[1]} episodes "
        "where that was tried; nobody can reach 0. To bound: to an upper bound on the expected return for the "
        "discretised sensor model, in which touches are independent given the shape and repeats have the observation "
        "model's price; live touches are neither, so live returns can exceed it, and the number is then negative. For "
        "searches small enough to solve.",
    )


def positions(comparison: Comparison) -> Sheet:
    """Success by where the target lay."""
    rows = [
        (name, place.label, place.num_episodes, place.success, place.interval, place.wrong, place.touches)
        for name, places in comparison.positions.items()
        for place in places
    ]
    return Sheet(
        "positions",
        "Success by the place of the target in the order of visit",
        [
            *(("decider", ""), ("place", ""), ("searches", "d"), ("success", ".3f")),
            *(("95 %", ".3f"), ("wrong", "d"), ("touches", ".2f")),
        ],
        rows,
        long=len(rows) > 20,
    )


def promises(comparison: Comparison) -> Sheet:
    """Promised against achieved error."""
    rows: list[Sequence[Value]] = []
    for name, found in comparison.claims.items():
        if found is None:
            rows.append((name, 0, None, None, None, "never confirmed"))
            continue
        s = found.overall
        kept = "yes" if s.is_consistent else ("claims too much" if s.mean_stated > s.high else "claims too little")
        rows.append((name, s.count, 1.0 - s.mean_stated, 1.0 - s.share_right, (1.0 - s.high, 1.0 - s.low), kept))
    return Sheet(
        "promises",
        "Promised and achieved error of confirmations",
        [
            *(("decider", ""), ("confirmed", "d"), ("promised", ".4f"), ("achieved", ".4f")),
            *(("95 %", ".4f"), ("kept", "")),
        ],
        rows,
        "Promised: mean posterior probability, when confirming, that the object is not the target. Achieved: how often "
        "it was not, with Clopper-Pearson intervals.",
    )


def claims(comparison: Comparison) -> Sheet:
    """Claim against right at the stop, by touches of the object."""
    rows = [
        (name, str(s.num_touches), s.count, s.mean_stated, s.share_right, (s.low, s.high))
        for name, found in comparison.claims.items()
        if found is not None
        for s in found.by_num_touches
    ]
    return Sheet(
        "claims",
        "Claim against right when confirming, by touches of the confirmed object",
        [
            *(("decider", ""), ("touches", ""), ("confirmed", "d")),
            *(("claim", ".3f"), ("right", ".3f"), ("95 %", ".3f")),
        ],
        rows,
        long=True,
    )


def touches(comparison: Comparison) -> Sheet:
    """How many searches took how many touches."""
    rows = [
        (name, number, count)
        for name in comparison.deciders
        for number, count in sorted(Counter(episode.num_touches for episode in comparison.of(name)).items())
    ]
    columns = [("decider", ""), ("touches", "d"), ("searches", "d")]
    return Sheet("touches", "Touches a search", columns, rows, long=True)


def times(comparison: Comparison) -> Sheet:
    """Time of a touch by part."""
    rows = []
    for name in comparison.deciders:
        seconds = comparison.cells[name, ALL].seconds
        if seconds.num_touches:
            ms = seconds.ms_per_touch()
            rows.append((name, seconds.num_touches, *ms.values(), sum(ms.values())))
    parts = ((part, ".2f") for part in ("physics", "network", "decision", "sum"))
    return Sheet("times", "Milliseconds a touch", [("decider", ""), ("touches", "d"), *parts], rows)
