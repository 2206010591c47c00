"""The results of a sweep in words, tables, a figure and a page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from belief.files import write_text
from belief.statistics import paired_bootstrap
from experiments.bayes_error.estimator import Grid
from experiments.reporting.page import Part, write_csv, write_page
from experiments.tradeoff.configuration import SHARES
from experiments.tradeoff.figures import front_figure, inline, write_figure
from experiments.tradeoff.measure import export_sensor
from experiments.tradeoff.picks import Front, Pick, Point

_CAPTION = (
    "Every point is a configuration with its 95 % Wilson interval: colours are scenes, markers say what is other than "
    "in the scene's default. The larger a point, the more likely it is on the front, which is the dashed line."
)
_COLUMNS = (
    "Success: of live searches, with its 95 % Wilson interval. To the default: the difference over the same "
    "searches, with its 95 % bootstrap interval. Times: processor time of one core; a search is its touches, each a "
    "press with its image, a reading of one image and a decision; planning, once for each target, is left out. Peak: "
    "of a process that loads the sensor and presses. On the front: the probability that no other of the task is both "
    "faster and at least as successful, given the searches."
)
_HEADINGS = (
    "configuration",
    "searches",
    "success",
    "to the default",
    "touches",
    "return",
    "ms a search",
    "ms a decision",
    "ms a press",
    "ms to read",
    "weights MB",
    "peak MB",
    "on the front",
)
_MAYBE = 0.1  # probability from which a point is worth a look


def write_report(folder: Path, found: Sequence[Front], answers: Mapping[str, Sequence[Pick]], arguments: Any) -> None:
    """Write report.html, tradeoff.md, .csv, .json and .svg."""
    write_figure(front_figure(found), folder / "tradeoff.svg")
    figures = [inline(front_figure([front]), f"front{number}") for number, front in enumerate(found)]
    said = sentences(answers, folder)
    short, whole = [_front_grid(front) for front in found], list(_whole_grids(found))
    parts = [
        Part("What to take", [_extent(found), *said], figures=figures, caption=_CAPTION),
        Part("The fronts, and what may be on them", [_COLUMNS], short),
        Part("All of it, by scene", grids=whole),
    ]
    write_page(folder / "report.html", "What speed costs in accuracy", parts)
    write_csv(folder / "tradeoff.csv", Grid("", _HEADINGS, [row for grid in whole for row in grid.rows]))
    text = ["\n".join(f"- {line}" for line in said), *(grid.markdown() for grid in [*short, *whole])]
    write_text(folder / "tradeoff.md", "\n\n".join(text) + "\n")
    points = [_entry(point, prob) for front in found for point, prob in zip(front.points, front.probs, strict=True)]
    numbers = {"arguments": arguments, "points": points, "answers": said}
    write_text(folder / "tradeoff.json", json.dumps(numbers, indent=1) + "\n")


def _extent(found: Sequence[Front]) -> str:
    points = [point for front in found for point in front.points]
    scenes = dict.fromkeys(point.configuration.scene for point in points)
    searches = f"{sum(point.num_searches for point in points):,}".replace(",", " ")
    return (
        f"{len(points)} configurations in {len(scenes)} scenes ({', '.join(scenes)}), {searches} live searches: "
        "the same ones for all configurations of a scene."
    )


def sentences(answers: Mapping[str, Sequence[Pick]], folder: Path) -> list[str]:
    """What to take, and the command that plays it; sensors that do not come with the package are written there."""
    lines = []
    for task, some in answers.items():
        for pick in some:
            if pick.point is None:
                lines.append(f"{task.capitalize()}, {pick.question}: none of these.")
                continue
            p = pick.point
            sensor = export_sensor(p.configuration, folder)
            low, high = p.interval
            lines.append(
                f"{task.capitalize()}, {pick.question}: {p.configuration.name}. Success {p.success:.3f} "
                f"[{low:.3f}, {high:.3f}] of {p.num_searches}, {p.touches:.2f} touches and "
                f"{p.ms_per_search:.1f} ms a search, {p.ms_per_touch:.2f} ms a touch. "
                f"Play it: {p.configuration.command(sensor)}"
            )
    return lines


def _front_grid(front: Front) -> Grid:
    """The front of a task and what may be on it, cheapest first."""
    defaults = _defaults([front])
    rows = [_row(point, prob, defaults) for point, prob in worthwhile(front)]
    return Grid(front.task, _HEADINGS, rows)


def worthwhile(front: Front) -> list[tuple[Point, float]]:
    """The points that are on the front or may be, with that probability, cheapest first."""
    chosen = zip(front.points, front.on_front, front.probs, strict=True)
    return [(point, float(prob)) for point, on, prob in chosen if on or prob >= _MAYBE]


def terminal_grid(front: Front) -> Grid:
    """The front of a task, and what may be on it, in few columns."""
    rows = [
        (
            p.configuration.name,
            f"{p.success:.3f} [{p.interval[0]:.3f}, {p.interval[1]:.3f}]",
            f"{p.touches:.1f}",
            f"{p.ms_per_search:.1f}",
            f"{prob:.2f}",
        )
        for p, prob in worthwhile(front)
    ]
    return Grid(front.task, ("the front", "success", "touches", "ms", "prob."), rows)


def _whole_grids(found: Sequence[Front]) -> Iterator[Grid]:
    """All configurations of every scene, cheapest first."""
    defaults = _defaults(found)
    for scene in SHARES:
        rows = [
            _row(point, prob, defaults)
            for front in found
            for point, prob in zip(front.points, front.probs, strict=True)
            if point.configuration.scene == scene
        ]
        if rows:
            yield Grid(scene, _HEADINGS, rows)


def _defaults(found: Sequence[Front]) -> dict[str, Point]:
    """By scene, as far as they were measured."""
    points = (point for front in found for point in front.points)
    return {point.configuration.scene: point for point in points if point.configuration.varied == "nothing"}


def _row(p: Point, prob: float, defaults: Mapping[str, Point]) -> tuple[str, ...]:
    low, high = p.interval
    return (
        p.configuration.name,
        str(p.num_searches),
        f"{p.success:.3f} [{low:.3f}, {high:.3f}]",
        _difference(p, defaults.get(p.configuration.scene)),
        f"{p.touches:.2f}",
        f"{p.reward:.3f}",
        f"{p.ms_per_search:.1f}",
        f"{p.result.ms_per_decision:.2f}",
        f"{p.cost.physics:.2f}",
        f"{p.cost.network:.2f}",
        f"{p.cost.weights:.1f}",
        f"{p.cost.memory:.0f}",
        f"{prob:.2f}",
    )


def _difference(point: Point, default: Point | None) -> str:
    """In success, over the same searches, with its 95 % interval."""
    if point is default:
        return "default"
    if default is None or point.num_searches != default.num_searches:
        return "–"
    mine, other = (np.array(p.result.successes, float) for p in (point, default))
    mean, low, high = paired_bootstrap(mine, other, np.random.default_rng(0))
    return f"{mean:+.3f} [{low:+.3f}, {high:+.3f}]"


def _entry(point: Point, prob: float) -> dict[str, object]:
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
