"""Report of the trade-off: sentences, tables, a figure and a page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from belief.files import write_text
from belief.statistics import paired_bootstrap
from belief.table import Table, Value, interval
from experiments.reporting.page import Section, write_page
from experiments.tradeoff.configuration import SHARES
from experiments.tradeoff.measure import Front, Measured, fronts, picks

_NOTE = (
    "Success: fraction of live searches, with its 95 % Wilson interval. Minus default: difference from the scene's "
    "default over the same searches, with its 95 % bootstrap interval. Times: processor time of one core. A search "
    "consists of touches, each a press with its image and a reading of this image, and of decisions; planning is not "
    "included."
)
_COLUMNS = (
    *("configuration", ("searches", "d"), "success", "minus default", ("touches", ".2f"), ("return", ".3f")),
    *(("ms per search", ".1f"), ("ms per decision", ".2f"), ("ms per press", ".2f"), ("ms per reading", ".2f")),
)


@dataclass(frozen=True, eq=False)
class TradeoffReport:
    """Measured configurations, and those recommended; prints as the Pareto fronts and the recommendations.

    Attributes:
        points: all configurations.
        least_success: lowest acceptable success.
        most_ms: longest acceptable time per touch [ms].
    """

    points: Sequence[Measured]
    least_success: float = 0.98
    most_ms: float = 50.0

    @cached_property
    def fronts(self) -> list[Front]:
        """Pareto front of every task."""
        return fronts(self.points)

    def sentences(self) -> list[str]:
        """Recommended configurations with their commands."""
        lines = []
        for front in self.fronts:
            for pick in picks(front, self.least_success, self.most_ms):
                question, p = f"{front.task.capitalize()}, {pick.question}", pick.point
                if p is None:
                    lines.append(f"{question}: no configuration.")
                    continue
                lines.append(
                    f"{question}: {p.configuration.name}. Success {interval(p.success, *p.interval)} of "
                    f"{p.num_searches}, {p.mean_touches:.2f} touches and {p.ms_per_search:.1f} ms per search, "
                    f"{p.ms_per_touch:.2f} ms per touch. "
                    f"Command: {p.configuration.command()}"
                )
        return lines

    def short_tables(self) -> list[Table]:
        """The Pareto front of every task, in few columns."""
        columns = ("configuration", "success", ("touches", ".1f"), ("ms", ".1f"))
        return [
            Table(
                f"{front.task}: nothing is both faster and as successful",
                columns,
                [
                    (p.configuration.name, interval(p.success, *p.interval), p.mean_touches, p.ms_per_search)
                    for p, on_front in zip(front.points, front.on_front, strict=True)
                    if on_front
                ],
            )
            for front in self.fronts
        ]

    def __str__(self) -> str:
        return "\n\n".join([*(table.markdown() for table in self.short_tables()), *self.sentences()])

    def save(self, folder: Path) -> None:
        """Write report.html and tradeoff.md, .csv, .json, .svg and .png.

        Raises:
            CannotWrite: The disk is full, or the folder is not writable.
        """
        from experiments.tradeoff.figures import front_picture  # loads matplotlib

        picture, recommended, tables = front_picture(self.fronts), self.sentences(), self.tables()
        sections = [
            Section("Recommended configurations", [_extent(self.points), *recommended], pictures=[picture]),
            Section("Pareto fronts", tables=self.short_tables()),
            Section("All configurations by scene", [_NOTE], tables),
        ]
        picture.write(folder)
        write_page(folder / "report.html", "Trade-off between speed and accuracy", sections)
        Table("", _COLUMNS, [row for table in tables for row in table.rows]).write_csv(folder / "tradeoff.csv")
        text = ["\n".join(f"- {line}" for line in recommended), *(table.markdown() for table in tables)]
        write_text(folder / "tradeoff.md", "\n\n".join(text) + "\n")
        numbers = {"points": [_entry(point) for point in self.points], "answers": recommended}
        write_text(folder / "tradeoff.json", json.dumps(numbers, indent=1) + "\n")

    def tables(self) -> list[Table]:
        """All configurations of every scene, fastest first."""
        defaults = {p.configuration.scene: p for p in self.points if p.configuration.varied == "nothing"}
        ordered = sorted(self.points, key=lambda point: point.ms_per_search)
        by_scene = {scene: [p for p in ordered if p.configuration.scene == scene] for scene in SHARES}
        return [
            Table(scene, _COLUMNS, [_row(p, defaults) for p in points]) for scene, points in by_scene.items() if points
        ]


def _extent(points: Sequence[Measured]) -> str:
    scenes = dict.fromkeys(point.configuration.scene for point in points)
    searches = f"{sum(point.num_searches for point in points):,}".replace(",", " ")
    return (
        f"{len(points)} configurations in {len(scenes)} scenes ({', '.join(scenes)}), {searches} live searches. "
        "All configurations of a scene played the same searches; those with fewer played the first for each target."
    )


def _row(p: Measured, defaults: Mapping[str, Measured]) -> tuple[Value, ...]:
    default = defaults.get(p.configuration.scene)
    if p is default:
        difference = "default"
    elif default is None or p.num_searches != default.num_searches:
        difference = "–"
    else:
        mine, other = (np.array(one.successes, float) for one in (p, default))
        difference = interval(*paired_bootstrap(mine, other, np.random.default_rng(0)), spec="+.3f")
    success = interval(p.success, *p.interval)
    times = (p.ms_per_search, p.ms_per_decision, p.ms_per_press, p.ms_per_reading)
    return (p.configuration.name, p.num_searches, success, difference, p.mean_touches, p.reward, *times)


def _entry(p: Measured) -> dict[str, object]:
    c = p.configuration
    return {
        "name": c.name,
        "key": c.key,
        "configuration": asdict(c),
        "varied": c.varied,
        "searches": p.num_searches,
        "success": p.success,
        "interval": p.interval,
        "touches": p.mean_touches,
        "return": p.reward,
        **{name: getattr(p, name) for name in ("ms_per_search", "ms_per_decision", "ms_per_press", "ms_per_reading")},
    }
