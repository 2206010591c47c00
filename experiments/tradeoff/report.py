"""Report of the trade-off: sentences, tables, a figure and a page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from belief.files import write_text
from belief.statistics import paired_bootstrap
from experiments.reporting.page import Section, write_page
from experiments.reporting.tables import Table, Value, interval
from experiments.tradeoff.configuration import SHARES
from experiments.tradeoff.figures import front_picture
from experiments.tradeoff.measure import export_sensor
from experiments.tradeoff.picks import Candidate, Front, Pick

_NOTE = (
    "Success: fraction of live searches, with its 95 % Wilson interval. Minus default: difference from the scene's "
    "default over the same searches, with its 95 % bootstrap interval. Times: processor time of one core. A search "
    "consists of touches, each a press with its image and a reading of this image, and of decisions; planning is not "
    "included. Peak: memory of a process that loads the sensor and presses. P(front): probability, given "
    "the searches, that no other configuration of the task is both faster and at least as successful."
)
_COLUMNS = (
    *("configuration", ("searches", "d"), "success", "minus default", ("touches", ".2f"), ("return", ".3f")),
    *(("ms per search", ".1f"), ("ms per decision", ".2f"), ("ms per press", ".2f"), ("ms per reading", ".2f")),
    *(("file MB", ".1f"), ("peak MB", ".0f"), ("P(front)", ".2f")),
)
_MAYBE = 0.1  # lowest P(front) of a candidate that is listed with the front


def write_tradeoff_report(
    folder: Path, found: Sequence[Front], answers: Mapping[str, Sequence[Pick]], arguments: Any
) -> None:
    """Write report.html and tradeoff.md, .csv, .json, .svg and .png.

    Args:
        folder: folder to write to.
        found: Pareto fronts of all tasks.
        answers: recommended configurations, by task.
        arguments: arguments of the command, for the record.

    Raises:
        CannotWrite: The disk is full, or the folder is not writable.
    """
    picture, said = front_picture(found), sentences(answers, folder)
    short, whole = [_front_table(front) for front in found], list(_scene_tables(found))
    sections = [
        Section("Recommended configurations", [_extent(found), *said], pictures=[picture]),
        Section("Pareto fronts and configurations that may lie on them", [_NOTE], short),
        Section("All configurations by scene", tables=whole),
    ]
    picture.write(folder)
    write_page(folder / "report.html", "Trade-off between speed and accuracy", sections)
    Table("", _COLUMNS, [row for table in whole for row in table.rows]).write_csv(folder / "tradeoff.csv")
    text = ["\n".join(f"- {line}" for line in said), *(table.markdown() for table in [*short, *whole])]
    write_text(folder / "tradeoff.md", "\n\n".join(text) + "\n")
    points = [_entry(point, prob) for front in found for point, prob in zip(front.points, front.probs, strict=True)]
    numbers = {"arguments": arguments, "points": points, "answers": said}
    write_text(folder / "tradeoff.json", json.dumps(numbers, indent=1) + "\n")


def _extent(found: Sequence[Front]) -> str:
    points = [point for front in found for point in front.points]
    scenes = dict.fromkeys(point.configuration.scene for point in points)
    searches = f"{sum(point.num_searches for point in points):,}".replace(",", " ")
    return (
        f"{len(points)} configurations in {len(scenes)} scenes ({', '.join(scenes)}), {searches} live searches. "
        "All configurations of a scene played the same searches; those with fewer played the first for each target."
    )


def sentences(answers: Mapping[str, Sequence[Pick]], folder: Path) -> list[str]:
    """Recommended configurations and their commands; writes their sensors to ``folder`` if they are not shipped."""
    lines = []
    for task, some in answers.items():
        for pick in some:
            if pick.point is None:
                lines.append(f"{task.capitalize()}, {pick.question}: no configuration.")
                continue
            p = pick.point
            sensor = export_sensor(p.configuration, folder)
            lines.append(
                f"{task.capitalize()}, {pick.question}: {p.configuration.name}. Success "
                f"{interval(p.success, *p.interval)} of {p.num_searches}, {p.touches:.2f} touches and "
                f"{p.ms_per_search:.1f} ms per search, {p.ms_per_touch:.2f} ms per touch. "
                f"Command: {p.configuration.command(sensor)}"
            )
    return lines


def _front_table(front: Front) -> Table:
    defaults = _defaults([front])
    return Table(front.task, _COLUMNS, [_row(point, prob, defaults) for point, prob in worthwhile(front)])


def worthwhile(front: Front) -> list[tuple[Candidate, float]]:
    """Candidates that are on the front or may be, each with its probability, fastest first."""
    chosen = zip(front.points, front.on_front, front.probs, strict=True)
    return [(point, float(prob)) for point, on, prob in chosen if on or prob >= _MAYBE]


def short_front_table(front: Front) -> Table:
    """Candidates that are on the front or may be, in few columns, for a terminal."""
    columns = ("configuration", "success", ("touches", ".1f"), ("ms", ".1f"), ("P(front)", ".2f"))
    rows = [
        (p.configuration.name, interval(p.success, *p.interval), p.touches, p.ms_per_search, prob)
        for p, prob in worthwhile(front)
    ]
    return Table(front.task, columns, rows)


def _scene_tables(found: Sequence[Front]) -> Iterator[Table]:
    """All configurations of every scene, fastest first."""
    defaults = _defaults(found)
    for scene in SHARES:
        rows = [
            _row(point, prob, defaults)
            for front in found
            for point, prob in zip(front.points, front.probs, strict=True)
            if point.configuration.scene == scene
        ]
        if rows:
            yield Table(scene, _COLUMNS, rows)


def _defaults(found: Sequence[Front]) -> dict[str, Candidate]:
    """Measured default configurations by scene."""
    points = (point for front in found for point in front.points)
    return {point.configuration.scene: point for point in points if point.configuration.varied == "nothing"}


def _row(p: Candidate, prob: float, defaults: Mapping[str, Candidate]) -> tuple[Value, ...]:
    difference = _difference(p, defaults.get(p.configuration.scene))
    return (
        *(p.configuration.name, p.num_searches, interval(p.success, *p.interval), difference, p.touches, p.reward),
        *(p.ms_per_search, p.result.ms_per_decision, p.cost.physics, p.cost.network),
        *(p.cost.size, p.cost.memory, float(prob)),
    )


def _difference(point: Candidate, default: Candidate | None) -> str:
    """Difference in success from the default over the same searches, with its 95 % interval."""
    if point is default:
        return "default"
    if default is None or point.num_searches != default.num_searches:
        return "–"
    mine, other = (np.array(p.result.successes, float) for p in (point, default))
    return interval(*paired_bootstrap(mine, other, np.random.default_rng(0)), spec="+.3f")


def _entry(point: Candidate, prob: float) -> dict[str, object]:
    c = point.configuration
    return {
        "name": c.name,
        "key": c.key,
        "configuration": asdict(c),
        "varied": c.varied,
        "searches": point.num_searches,
        "success": point.success,
        "interval": point.interval,
        "touches": point.touches,
        "return": point.reward,
        "ms_per_search": point.ms_per_search,
        "ms_per_decision": point.result.ms_per_decision,
        "planning_seconds": point.result.planning_seconds,
        **asdict(point.cost),
        "prob_on_front": float(prob),
    }
