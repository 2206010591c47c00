"""A comparison as a table for a terminal."""

from __future__ import annotations

from dataclasses import replace

from experiments.command_line.console import plain_console
from experiments.reporting.tables import Table
from experiments.search.summary import ALL, Comparison

_MOST_ROWS = 40  # a longer table has no rows of single targets
_DROPPED = ("ms/touch", "none", "wrong", "95 %", "touches")  # columns to omit on a narrow terminal, in this order


def terminal_table(comparison: Comparison, width: int = 80) -> Table:
    """The comparison as a table for a terminal; columns that do not fit are omitted.

    Args:
        comparison: results to show.
        width: width of the terminal [characters].
    """
    whole, omitted = _table(comparison), 0
    whole = whole if comparison.is_selective else whole.without(["unsure"])
    table, console = whole, plain_console(width=10_000)
    while omitted < len(_DROPPED) and console.measure(table.rich()).maximum > width:
        omitted += 1
        table = whole.without(_DROPPED[:omitted])
    last = f"Omitted: {', '.join(_DROPPED[:omitted])}" if omitted else "ms/touch = physics+network+decision"
    note = (
        f"{next(iter(comparison.cells.values())).num_episodes} live searches per decider and target, 95 % Wilson "
        f"intervals. No-touch baseline {comparison.no_touch_baseline:.2f}; full-information oracle "
        f"{comparison.oracle[0]}/{comparison.oracle[1]}. {last}"
    )
    return replace(table, note=note)


def _table(comparison: Comparison) -> Table:
    by_target = len(comparison.deciders) * (len(comparison.targets) + 1) <= _MOST_ROWS
    rows: list[tuple[str, ...]] = []
    for decider in comparison.deciders:
        rows.append((decider,))
        for target in [*(comparison.targets if by_target else ()), ALL]:
            cell = comparison.cells[decider, target]
            low, high = cell.success_interval
            ms = "+".join(f"{part:.{part < 10:d}f}" for part in cell.seconds.ms_per_touch().values())
            counts = (str(cell.wrong), str(cell.none + cell.truncated), str(cell.unsure), f"{cell.touches:.2f}")
            rows.append(
                (f"  {target}", f"{cell.success:.3f}", f"{low:.2f}–{high:.2f}", *counts, ms if cell.touches else "–")
            )
    return Table("", ["target", "success", "95 %", "wrong", "none", "unsure", "touches", "ms/touch"], rows)
