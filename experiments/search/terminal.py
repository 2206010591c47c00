"""A comparison as a table for a terminal."""

from __future__ import annotations

from rich import box
from rich.table import Table
from rich.text import Text

from experiments.command_line.console import plain_console
from experiments.search.summary import Comparison
from experiments.search.tables import ALL

_MOST_ROWS = 40  # with more, targets are left to the report


_HEADINGS = ("target", "success", "95 %", "wrong", "none", "touches", "ms/touch")
_DROPPED = ("ms/touch", "none", "wrong", "95 %", "touches")  # in turn, where names leave no room


def render_table(comparison: Comparison, width: int = 80) -> Table:
    """The comparison as a table that fits a terminal: names are whole, columns are left to the report before that."""
    shown = list(_HEADINGS)
    for left_out in _DROPPED:
        if _needed(table := _table(comparison, shown)) <= width:
            return table
        shown.remove(left_out)
    return _table(comparison, shown)


def _needed(table: Table) -> int:
    return plain_console(width=10_000).measure(table).maximum


def _table(comparison: Comparison, shown: list[str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), caption_justify="left")
    table.caption = (
        f"{next(iter(comparison.cells.values())).num_episodes} live searches per decider and target, 95 % Wilson "
        f"intervals. Floor (without touching) {comparison.floor:.2f}; ceiling (touch everything first) "
        f"{comparison.ceiling[0]}/{comparison.ceiling[1]}."
    )
    if "ms/touch" in shown:
        table.caption += " ms/touch = physics+network+decision"
    elif left_out := [heading for heading in _HEADINGS if heading not in shown]:
        table.caption += f" No room here for {', '.join(left_out)}: see the report"
    for heading in shown:
        # A name longer than the terminal is wide goes on in the next line.
        table.add_column(
            heading,
            justify="left" if heading == "target" else "right",
            no_wrap=heading != "target",
            overflow="fold",
        )
    by_target = len(comparison.deciders) * (len(comparison.targets) + 1) <= _MOST_ROWS
    for decider in comparison.deciders:
        table.add_row(Text(decider), style="bold")
        for target in [*(comparison.targets if by_target else ()), ALL]:
            cell = comparison.cells[decider, target]
            low, high = cell.success_interval
            ms = cell.seconds.ms_per_touch()
            values = {
                "target": Text(f"  {target}"),
                "success": f"{cell.success:.3f}",
                "95 %": f"{low:.3f}–{high:.3f}".replace("0.", ".").replace("1.000", "1"),
                "wrong": str(cell.wrong),
                "none": str(cell.none + cell.truncated),
                "touches": f"{cell.touches:.2f}",
                "ms/touch": "+".join(f"{part:.{part < 10:d}f}" for part in ms.values()) if cell.touches else "–",
            }
            table.add_row(*(values[heading] for heading in shown), end_section=target == ALL)
    return table
