"""Tables of a comparison."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from experiments.reporting.tables import Table, Value
from experiments.search.cards import ENOUGH
from experiments.search.selective_tables import abstention_table, selective_risk_table
from experiments.search.summary import ALL, Comparison

_SEARCHES = ("searches", "d")
_SUCCESS = (("success", ".3f"), ("95 %", ".3f"))


def comparison_tables(comparison: Comparison) -> list[Table]:
    """All tables of a comparison."""
    return [
        _results(comparison),
        _differences(comparison),
        _returns(comparison),
        _positions(comparison),
        _stated_confidence(comparison),
        _calibration_at_stopping(comparison),
        *([abstention_table(comparison), selective_risk_table(comparison)] if comparison.is_selective else []),
        _touches(comparison),
        _times(comparison),
    ]


def _results(comparison: Comparison) -> Table:
    rows = []
    for decider in comparison.deciders:
        for target in [*comparison.targets, ALL]:
            cell = comparison.cells[decider, target]
            counts = (cell.wrong, cell.none, cell.truncated, cell.unsure)
            touched = (cell.touches, *cell.touch_quantiles)
            rows.append((decider, target, cell.num_episodes, cell.success, cell.success_interval, *counts, *touched))
    table = Table(
        "Success by target",
        [
            *("decider", ("target", ""), _SEARCHES, *_SUCCESS),
            *(("wrong", "d"), ("none", "d"), ("cut off", "d"), ("unsure", "d")),
            *(("touches", ".2f"), ("half ≤", "d"), ("90 % ≤", "d"), ("most", "d")),
        ],
        rows,
        "Wilson intervals. Wrong: the decider confirmed an object of another shape. None: it rejected every object "
        "although the target was there. Cut off: the search reached the touch limit."
        + (" Unsure: it answered “I do not know”." if comparison.is_selective else ""),
        "results",
    )
    return table if comparison.is_selective else table.without(["unsure"])


def _differences(comparison: Comparison) -> Table:
    rows = [
        (
            *(name, d.success[0], d.success[1:], d.mcnemar.first_only, d.mcnemar.second_only, d.p_value),
            *(d.episodes_for_success, d.touches[0], d.touches[1:], d.reward[0], d.reward[1:]),
        )
        for name, d in comparison.differences.items()
    ]
    return Table(
        f"Difference from {comparison.reference} on the same episodes",
        [
            *("decider", ("success", "+.3f"), ("95 % ", "+.3f")),
            *(("only this succeeds", "d"), ("only the reference", "d"), ("p", ".2g"), ("searches needed", ",d")),
            *(("touches", "+.2f"), ("95 %  ", "+.2f"), ("return", "+.3f"), ("95 %   ", "+.3f")),
        ],
        rows,
        "Mean differences with 95 % bootstrap intervals over pairs, which are too narrow for fewer than "
        f"{ENOUGH} searches. p: McNemar's test (mid-p), corrected by Holm for "
        "the number of deciders. Searches needed: number of searches per decider at which this test detects a "
        "difference of the observed size with 80 % power."
        + (" A search that ends with “I do not know” does not succeed." if comparison.is_selective else ""),
        "differences",
    )


def _returns(comparison: Comparison) -> Table:
    rows = []
    for name, (mean, *interval) in comparison.regret.items():
        gap = comparison.gap[name]
        to_bound = (None, None) if gap is None else (gap[0], gap[1:])
        own = (name, comparison.cells[name, ALL].reward, comparison.prob_best[name])
        rows.append((*own, mean, tuple(interval), *to_bound))
    return Table(
        "Return and regret",
        [
            *("decider", ("return", ".3f"), ("P(best)", ".3f"), ("regret", ".3f"), ("95 %", ".3f")),
            *(("to bound", ".3f"), ("95 % ", ".3f")),
        ],
        rows,
        f"Return: +1 for success, {_unsure_reward(comparison)}−1 otherwise, minus "
        f"{comparison.problem.touch_cost:g} per touch. P(best): fraction "
        "of bootstrap resamples of the episodes in which the mean return is the highest. Regret: difference to the "
        "return of the full-information oracle, which touches every object in every pose free of charge before it "
        f"answers, on the {comparison.oracle[1]} episodes on which the oracle was run. To "
        "bound: difference to an upper bound on the expected return for the discretised sensor model. In that model "
        "touches are independent given the shape, and repeats are discounted as the observation model says. Live "
        "touches satisfy neither, so live returns can exceed the bound and the difference can be negative. It is "
        "given for searches that are small enough to solve.",
        "returns",
    )


def _unsure_reward(comparison: Comparison) -> str:
    reward = comparison.problem.unsure_reward
    return "" if reward is None else f"{reward:g} for “I do not know”, "


def _positions(comparison: Comparison) -> Table:
    rows = [
        (name, place.label, place.num_episodes, place.success, place.interval, place.wrong, place.touches)
        for name, places in comparison.positions.items()
        for place in places
    ]
    return Table(
        "Success by position of the target in the order of visit",
        ["decider", ("position", ""), _SEARCHES, *_SUCCESS, ("wrong", "d"), ("touches", ".2f")],
        rows,
        name="positions",
        is_long=len(rows) > 20,
    )


def _stated_confidence(comparison: Comparison) -> Table:
    rows: list[Sequence[Value]] = []
    for name, found in comparison.calibration.items():
        if found is None:
            rows.append((name, 0, None, None, None, "never confirmed"))
            continue
        s = found.overall
        judged = "yes" if s.is_consistent else ("overconfident" if s.mean_stated > s.high else "underconfident")
        rows.append((name, s.count, 1.0 - s.mean_stated, 1.0 - s.share_right, (1.0 - s.high, 1.0 - s.low), judged))
    return Table(
        "Stated and observed error of confirmations",
        [
            *("decider", ("confirmed", "d"), ("stated error", ".4f"), ("observed error", ".4f")),
            *(("95 %", ".4f"), ("calibrated", "")),
        ],
        rows,
        "Stated error: mean posterior probability at confirmation that the object is not the target. Observed error: "
        "fraction of confirmed objects that were not the target, with Clopper-Pearson intervals.",
        "stated_confidence",
    )


def _calibration_at_stopping(comparison: Comparison) -> Table:
    rows = [
        (name, str(s.num_touches), s.count, s.mean_stated, s.share_right, (s.low, s.high))
        for name, found in comparison.calibration.items()
        if found is not None
        for s in found.by_num_touches
    ]
    return Table(
        "Stated confidence and fraction correct at confirmation, by touches of the confirmed object",
        [
            *("decider", ("touches", ""), ("confirmed", "d")),
            *(("stated confidence", ".3f"), ("fraction correct", ".3f"), ("95 %", ".3f")),
        ],
        rows,
        name="calibration_at_stopping",
        is_long=True,
    )


def _touches(comparison: Comparison) -> Table:
    rows = [
        (name, number, count)
        for name in comparison.deciders
        for number, count in sorted(Counter(episode.num_touches for episode in comparison.of(name)).items())
    ]
    return Table("Touches per search", ["decider", ("touches", "d"), _SEARCHES], rows, name="touches", is_long=True)


def _times(comparison: Comparison) -> Table:
    rows = []
    for name in comparison.deciders:
        seconds = comparison.cells[name, ALL].seconds
        if seconds.num_touches:
            ms = seconds.ms_per_touch()
            rows.append((name, seconds.num_touches, *ms.values(), sum(ms.values())))
    parts = ((part, ".2f") for part in ("physics", "network", "decision", "sum"))
    return Table("Milliseconds per touch", ["decider", ("touches", "d"), *parts], rows, name="times")
