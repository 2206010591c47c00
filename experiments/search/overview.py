"""Comparisons in several worlds side by side: one table, one page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from belief.files import write_text
from experiments.search.report import csv_link, environment
from experiments.search.summary import Comparison
from experiments.search.tables import ALL, Sheet
from experiments.search.verdict import verdict


def overview(comparisons: Mapping[str, Comparison]) -> Sheet:
    """Every decider in every world, with the floor and the ceiling there."""
    rows = []
    for name, comparison in comparisons.items():
        solved, tried = comparison.ceiling
        for decider in comparison.deciders:
            cell = comparison.cells[decider, ALL]
            rows.append(
                (
                    *(name, decider, cell.num_episodes, cell.success, cell.success_interval, cell.touches, cell.reward),
                    *(comparison.prob_best[decider], comparison.floor, solved / tried),
                )
            )
    return Sheet(
        "overview",
        "All worlds",
        [
            *(("world", ""), ("decider", ""), ("searches", "d"), ("success", ".3f"), ("95 %", ".3f")),
            *(("touches", ".2f"), ("return", ".3f"), ("P(best)", ".3f"), ("floor", ".2f"), ("ceiling", ".3f")),
        ],
        rows,
        "Wilson intervals. P(best): share of bootstrap resamples of the episodes in which the mean return is highest.",
    )


def write_overview(folder: Path, comparisons: Mapping[str, Comparison]) -> Path:
    """Write ``overview.html`` and ``overview.csv``; return the path of the page, which links to the others."""
    sheet = overview(comparisons)
    write_text(folder / "overview.csv", sheet.csv())
    html = (
        environment()
        .get_template("overview.html")
        .render(sheet=sheet, file=csv_link(sheet), verdicts={name: verdict(c)[0] for name, c in comparisons.items()})
    )
    path = folder / "overview.html"
    write_text(path, html)
    return path
