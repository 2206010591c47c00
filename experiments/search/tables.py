"""Tables of a comparison."""

from __future__ import annotations

from collections.abc import Sequence

from belief.table import Table, Value, ends
from experiments.search.summary import ALL, Summary
from experiments.search.verdict import ENOUGH, is_calibrated

_MOST_ROWS = 40  # a longer table has no rows of single targets


def comparison_tables(comparison: Summary) -> list[Table]:
    """All tables of a comparison."""
    results = results_table(comparison)
    return [
        results if comparison.is_selective else results.without(["unsure"]),
        _differences(comparison),
        _stated_confidence(comparison),
        _times(comparison),
    ]


def results_table(comparison: Summary) -> Table:
    """Results of every decider for every target, and for all of them."""
    rows, unsure = [], comparison.problem.unsure_reward
    unsure_words = "" if unsure is None else f"{unsure:g} for “I do not know”, "
    for decider in comparison.deciders:
        for target in [*comparison.targets, ALL]:
            cell = comparison.cells[decider, target]
            counts = (cell.wrong, cell.none, cell.truncated, cell.unsure)
            touched = (cell.touches, *cell.touch_quantiles)
            returned = (cell.reward, comparison.prob_best[decider] if target == ALL else None)
            rows.append(
                (decider, target, cell.num_episodes, cell.success, cell.success_interval, *counts, *touched, *returned)
            )
    return Table(
        "Success by target",
        [
            *("decider", ("target", ""), ("searches", "d", "episodes"), ("success", ".3f"), ("95 %", ".3f")),
            *(("wrong", "d"), ("none", "d"), ("cut off", "d", "truncated"), ("unsure", "d"), ("touches", ".2f")),
            *(("half ≤", "d", "touches_median"), ("90 % ≤", "d", "touches_90"), ("most", "d", "touches_most")),
            *(("return", ".3f"), ("P(best)", ".3f", "prob_best")),
        ],
        rows,
        "Wilson intervals. Wrong: the decider confirmed an object of another shape. None: it rejected every object "
        "although the target was there. Cut off: the search reached the touch limit. "
        + ("Unsure: it answered “I do not know”. " if comparison.is_selective else "")
        + f"Return: +1 for success, {unsure_words}−1 otherwise, minus {comparison.problem.touch_cost:g} per touch. "
        "P(best): fraction of bootstrap resamples of the episodes in which the mean return is the highest.",
        "results",
    )


def _differences(comparison: Summary) -> Table:
    rows = [(name, *found.cells) for name, found in comparison.differences.items()]
    return Table(
        f"Difference from {comparison.reference} on the same episodes",
        [
            *("decider", ("success", "+.3f"), ("95 %", "+.3f")),
            *(("only this succeeds", "d"), ("only the reference", "d"), ("p", ".2g"), ("searches needed", ",d")),
            *(("touches", "+.2f"), ("95 %", "+.2f"), ("return", "+.3f"), ("95 %", "+.3f")),
        ],
        rows,
        "Mean differences with 95 % bootstrap intervals over pairs, which are too narrow for fewer than "
        f"{ENOUGH} searches. p: McNemar's test (mid-p), corrected by Holm for "
        "the number of deciders. Searches needed: number of searches per decider at which this test detects a "
        "difference of the observed size with 80 % power."
        + (" A search that ends with “I do not know” does not succeed." if comparison.is_selective else ""),
        "differences",
    )


def _stated_confidence(comparison: Summary) -> Table:
    rows: list[Sequence[Value]] = []
    for name, found in comparison.calibration.items():
        if found is None:
            rows.append((name, 0, None, None, None, "never confirmed"))
            continue
        s = found.overall
        errors = 1.0 - s.mean_stated, 1.0 - s.share_right, (1.0 - s.high, 1.0 - s.low)
        rows.append((name, s.count, *errors, is_calibrated(s)))
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


def _times(comparison: Summary) -> Table:
    rows = []
    for name in comparison.deciders:
        seconds = comparison.cells[name, ALL].seconds
        if seconds.num_touches:
            ms = seconds.ms_per_touch()
            rows.append((name, seconds.num_touches, *ms.values(), sum(ms.values())))
    parts = ((part, ".2f") for part in ("physics", "network", "decision", "sum"))
    return Table("Milliseconds per touch", ["decider", ("touches", "d"), *parts], rows, name="times")


def terminal_table(comparison: Summary) -> Table:
    """The comparison as a table for a terminal: a row for each target below the name of each decider."""
    by_target = len(comparison.deciders) * (len(comparison.targets) + 1) <= _MOST_ROWS
    rows: list[tuple[str, ...]] = []
    for decider in comparison.deciders:
        rows.append((decider,))
        for target in [*(comparison.targets if by_target else ()), ALL]:
            cell = comparison.cells[decider, target]
            success = "–".join(ends(*cell.success_interval, ".2f"))
            ms = "+".join(f"{part:.{part < 10:d}f}" for part in cell.seconds.ms_per_touch().values())
            counts = (str(cell.wrong), str(cell.none + cell.truncated), str(cell.unsure), f"{cell.touches:.2f}")
            rows.append((f"  {target}", f"{cell.success:.3f}", success, *counts, ms if cell.touches else "–"))
    table = Table(
        "",
        ["target", "success", "95 %", "wrong", "none", "unsure", "touches", "ms/touch"],
        rows,
        f"{next(iter(comparison.cells.values())).num_episodes} live searches per decider and target, 95 % Wilson "
        f"intervals. No-touch baseline {comparison.no_touch_baseline:.2f}. ms/touch = physics+network+decision",
    )
    return table if comparison.is_selective else table.without(["unsure"])
