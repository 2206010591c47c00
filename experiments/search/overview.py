"""Overview of comparisons in several scenes: one table and one page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from experiments.reporting.page import Section, write_page
from experiments.reporting.tables import Table
from experiments.search.summary import ALL, Comparison
from experiments.search.verdict import verdict_sentences


def overview(comparisons: Mapping[str, Comparison]) -> Table:
    """Results of every decider in every scene, with the no-touch baseline and the full-information oracle."""
    rows, is_selective = [], any(comparison.is_selective for comparison in comparisons.values())
    for name, comparison in comparisons.items():
        solved, tried = comparison.oracle
        for decider in comparison.deciders:
            cell = comparison.cells[decider, ALL]
            rows.append(
                (
                    *(name, decider, cell.num_episodes, cell.success, cell.success_interval),
                    *(cell.unsure / cell.num_episodes, cell.touches, cell.reward),
                    *(comparison.prob_best[decider], comparison.no_touch_baseline, solved / tried),
                )
            )
    table = Table(
        "All scenes",
        [
            *("scene", ("decider", ""), ("searches", "d"), ("success", ".3f"), ("95 %", ".3f"), ("unsure", ".3f")),
            *(("touches", ".2f"), ("return", ".3f"), ("P(best)", ".3f")),
            *(("no-touch baseline", ".2f"), ("oracle", ".3f")),
        ],
        rows,
        "Wilson intervals. P(best): fraction of bootstrap resamples of the episodes in which the mean return is the "
        "highest. Oracle: success of the full-information oracle, which touches every object in every pose first.",
        "overview",
    )
    return table if is_selective else table.without(["unsure"])


def write_overview(folder: Path, comparisons: Mapping[str, Comparison]) -> Path:
    """Write ``overview.html`` and ``overview.csv``.

    Args:
        folder: parent folder of the runs.
        comparisons: comparison by name of its subfolder.

    Returns:
        Path of the page, which links to the reports of the runs.

    Raises:
        CannotWrite: The disk is full, or the folder is not writable.
    """
    table, path = overview(comparisons), folder / "overview.html"
    table.write_csv(folder / "overview.csv")
    verdicts = {name: verdict_sentences(comparison)[0] for name, comparison in comparisons.items()}
    section = Section("All scenes", tables=[table])
    write_page(path, "Searching by touch in several scenes", [section], "overview.html", verdicts=verdicts)
    return path
