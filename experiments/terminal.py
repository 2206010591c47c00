"""A comparison as a table for a terminal."""

from __future__ import annotations

from rich import box
from rich.table import Table

from experiments.sheets import ALL
from experiments.summary import Comparison

_MOST_ROWS = 40  # with more, targets are left to the report


def render_table(comparison: Comparison) -> Table:
    """The comparison as a table that fits an 80-column terminal."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), caption_justify="left")
    table.caption = (
        f"{next(iter(comparison.cells.values())).num_episodes} live searches per decider and target, 95 % Wilson "
        f"intervals. Floor (without touching) {comparison.floor:.2f}; ceiling (touch everything first) "
        f"{comparison.ceiling[0]}/{comparison.ceiling[1]}. ms/touch = physics+network+decision"
    )
    for heading in ("target", "success", "95 %", "wrong", "none", "touches", "ms/touch"):
        table.add_column(heading, justify="left" if heading == "target" else "right", no_wrap=True)
    by_target = len(comparison.deciders) * (len(comparison.targets) + 1) <= _MOST_ROWS
    for decider in comparison.deciders:
        table.add_row(decider, style="bold")
        for target in [*(comparison.targets if by_target else ()), ALL]:
            cell = comparison.cells[decider, target]
            low, high = cell.success_interval
            ms = cell.seconds.ms_per_touch()
            table.add_row(
                f"  {target}",
                f"{cell.success:.3f}",
                f"{low:.3f}–{high:.3f}".replace("0.", ".").replace("1.000", "1"),
                str(cell.wrong),
                str(cell.none + cell.truncated),
                f"{cell.touches:.2f}",
                "+".join(f"{part:.{part < 10:d}f}" for part in ms.values()) if cell.touches else "–",
                end_section=target == ALL,
            )
    return table
