"""Tables and figure of ``robustness``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.reporting.style import PALETTE, figure
from experiments.reporting.tables import Table, interval
from experiments.robustness.shifted_touches import AS_TRAINED

_TICKS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)


def robustness_tables(numbers: Mapping[str, Any]) -> list[Table]:
    """Tables of a report, from the contents of ``robustness.json``."""
    name, of = numbers["scene"], f"{numbers['objects_per_shape']} objects of every shape, {numbers['num_poses']} poses"
    rows = []
    for condition, row in numbers["conditions"].items():
        fewer = row["num_objects"] < numbers["conditions"][AS_TRAINED]["num_objects"]
        rows.append(
            (
                f"{condition} ({row['num_objects']} objects)" if fewer else condition,
                interval(row["accuracy"], *row["accuracy_interval"]) + (" (chance)" if row["is_chance"] else ""),
                interval(row["difference"], *row["difference_interval"], spec="+.3f")
                if condition != AS_TRAINED
                else "",
                f"{row['nll']:.3f}",
                f"{row['ece']:.3f}",
                interval(row["fused_accuracy"], *row["fused_interval"]),
            )
        )
    headings = ("condition", "accuracy, one touch", "difference", "NLL", "ECE", "all touches fused")
    found = [Table(f"{name}: accuracy in other conditions than trained ({of})", headings, rows)]
    if numbers["unseen"]:
        pairs = [(score, unit) for score in ("energy", "mahalanobis") for unit in ("touch", "object")]
        unseen = [
            (
                label,
                *(interval(*row["auroc"][score][unit]) for score, unit in pairs),
                f"{row['taken_for']} ({row['share']:.0%})",
                f"{row['confidence']:.3f}",
            )
            for label, row in numbers["unseen"].items()
        ]
        columns = ("unseen shape", *(f"{score}, {unit}" for score, unit in pairs), "taken for", "confidence")
        found.append(Table(f"{name}: AUROC of unseen against known shapes ({of})", columns, unseen))
    if numbers["left_out"]:
        found.append(Table("left out", ("condition", ("because", "")), list(numbers["left_out"].items())))
    return found


def draw_conditions(numbers: Mapping[str, Any], *paths: Path) -> None:
    """Draw the error rates of one touch and of all touches fused; the endings of the paths decide the formats.

    The scale is logarithmic above 1 % and linear below, so that it can show zero.
    """
    rows, trained = numbers["conditions"], numbers["conditions"][AS_TRAINED]
    with figure((9, 1.3 + 0.24 * len(rows)), *paths) as drawn:
        drawn.suptitle(f"{numbers['scene']}: {trained['num_objects']} objects, intervals at 95 %")
        panels = (("accuracy", "accuracy_interval", "one touch"), ("fused_accuracy", "fused_interval", "all touches"))
        for axes, (key, bounds, title) in zip(drawn.subplots(1, 2, sharey=True), panels, strict=True):
            values = 1.0 - np.array([row[key] for row in rows.values()])
            high, low = 1.0 - np.array([row[bounds] for row in rows.values()]).T
            axes.axvspan(*(1.0 - bound for bound in trained[bounds]), color="0.9", linewidth=0)
            axes.axvline(1.0 - trained[key], color="0.5", linewidth=1)
            axes.axvline(1.0 - numbers["chance"], color="0.5", linewidth=1, linestyle=":")
            reach = np.maximum([values - low, high - values], 0.0)  # a mean and its quantiles round differently
            axes.errorbar(values, list(rows), xerr=reach, fmt="o", color=PALETTE[0], markersize=4, elinewidth=1)
            axes.set(title=title, xlabel="error rate (line: as trained; dotted: chance)")
            axes.set_xscale("symlog", linthresh=0.01, linscale=0.7)
            axes.set(
                xlim=(-0.001, 1.0), xticks=_TICKS, xticklabels=[f"{100 * tick:g}" for tick in _TICKS[:-1]] + ["100 %"]
            )
            axes.minorticks_off()
            axes.grid(axis="x", alpha=0.25)
        axes.invert_yaxis()
