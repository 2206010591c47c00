"""Report of a comparison: its figures, and one HTML page with verdict, tables and a few searches to step through."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib import colormaps, rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from numpy.typing import NDArray
from PIL import Image

from experiments.report import Picture, Report, Section, data_uri
from experiments.search.play import Searches, action_words, body_words, replay, shown_shapes
from experiments.search.run import RunFolder
from experiments.search.summary import ALL, Cell, Summary
from experiments.search.verdict import by_return, comparison_tables
from experiments.sensor_choice import shift_sentences
from planners import Episode, Outcome

_WIDTH = 5.2  # inches; narrow, so that text stays readable on a phone
_MARKERS = "osD^vP*X"


def pictures(comparison: Summary) -> list[Picture]:
    """All figures of a comparison."""
    num_deciders, num_groups = len(comparison.deciders), len(comparison.targets) + 1
    return [
        Picture(name, caption, [partial(FIGURES[name], comparison)], size=(_WIDTH, height))
        for name, caption, height in (
            ("success", _SUCCESS, 1.0 + num_groups * (0.16 * num_deciders + 0.16)),
            ("frontier", _FRONTIER, 3.4),
        )
    ]


_SUCCESS = (
    "Fraction of failed searches by target, with 95 % Wilson intervals, on a logarithmic axis: points further left are "
    "better. An open marker at the left edge stands for no failure at all. The dotted line is the no-touch baseline."
)
_FRONTIER = (
    "Fraction of failed searches against touches per search, over all targets. Points further down and to the left are "
    "better. An open marker at the lower edge stands for no failure at all. The dotted line is the no-touch baseline."
)


def draw_success(comparison: Summary, axes: Axes) -> None:
    """Draw the fraction of failed searches by target."""
    groups, least, count = [*comparison.targets, ALL], _least_failure(comparison), len(comparison.deciders)
    axes.axvline(1.0 - comparison.no_touch_baseline, color=rcParams["text.color"], linestyle=":", linewidth=1)
    for index, decider in enumerate(comparison.deciders):
        for place, group in enumerate(groups):
            y = place + 0.7 * ((index + 0.5) / count - 0.5)
            value, bars, style = _failures(comparison.cells[decider, group], least, index)
            axes.errorbar(value, y, xerr=bars, **style, label=decider if place == 0 else None)
    axes.set(xscale="log", xlabel="failed searches", xlim=(least / 1.4, 1.4))
    axes.set(yticks=np.arange(len(groups)), yticklabels=groups)
    _plain_numbers(axes.xaxis)
    axes.invert_yaxis()
    _legend(axes, comparison)


def draw_frontier(comparison: Summary, axes: Axes) -> None:
    """Draw the fraction of failed searches against touches per search."""
    least, count = _least_failure(comparison), len(comparison.deciders)
    axes.axhline(1.0 - comparison.no_touch_baseline, color=rcParams["text.color"], linestyle=":", linewidth=1)
    for index, decider in enumerate(comparison.deciders):
        value, bars, style = _failures(comparison.cells[decider, ALL], least, index)
        style["markersize"] = 5 + 5.4 * (count - 1 - index) / max(count - 1, 1)  # the first is largest: none hides
        axes.errorbar(comparison.cells[decider, ALL].touches, value, yerr=bars, **style, label=decider)
    axes.set(yscale="log", xlabel="touches per search", ylabel="failed searches", ylim=(least / 1.4, 1.4))
    _plain_numbers(axes.yaxis)
    axes.set_xlim(left=-0.04 * axes.get_xlim()[1])
    _legend(axes, comparison)


FIGURES: Mapping[str, Callable[[Summary, Axes], None]] = MappingProxyType(
    {"success": draw_success, "frontier": draw_frontier}
)
"""Functions that draw a figure of a comparison on an axis, by name."""


def _least_failure(comparison: Summary) -> float:
    """Fraction that stands for zero on a logarithmic axis: half a failure in the largest group."""
    return 0.5 / max(cell.num_episodes for cell in comparison.cells.values())


def _failures(cell: Cell, least: float, index: int) -> tuple[float, list[list[float]], dict[str, Any]]:
    """Fraction of failures, lengths of its error bar, and its style; no failures at all have an open marker."""
    low, high = (1.0 - end for end in reversed(cell.success_interval))
    value, marker = 1.0 - cell.success, _MARKERS[index % len(_MARKERS)]  # for readers who cannot tell colours apart
    style = {"color": f"C{index}", "marker": marker, "linestyle": "none", "markersize": 5, "linewidth": 1.3}
    if cell.successes == cell.num_episodes:
        return least, [[0.0], [max(high - least, 0.0)]], style | {"markerfacecolor": "none"}
    return value, [[value - max(low, least)], [max(high - value, 0.0)]], style


def _plain_numbers(axis: Axis) -> None:
    """Label a logarithmic axis with 0.01, not with powers, which take a tenth of a report's time to typeset."""
    axis.set_major_formatter("{x:g}")
    low, high = axis.get_view_interval()
    between = "235" if high < 10 * low else ""  # also 0.2, 0.3 and 0.5 where less than a decade is shown
    axis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in between else "")


def _legend(axes: Axes, comparison: Summary) -> None:
    widest = 0.55 + 0.075 * max(map(len, comparison.deciders))  # inches
    width = axes.get_window_extent().width / axes.figure.dpi / 0.78  # with the labels beside the axis, about
    columns = min(max(int(width / widest), 1), len(comparison.deciders))
    axes.legend(frameon=False, ncols=columns, loc="lower center", bbox_to_anchor=(0.5, 1))


_SECTIONS = {"Success": ("results", "differences"), "Stated confidence": ("stated_confidence",), "Time": ("times",)}
_FAILURES = {
    Outcome.CONFIRMED: "confirmed the wrong object",
    Outcome.EXHAUSTED: "rejected every object",
    Outcome.TRUNCATED: "reached the touch limit",
    Outcome.UNSURE: "answered “I do not know”",
}


def report_of(run: RunFolder, comparison: Summary, searches: Searches, verdict: Sequence[str]) -> Report:
    """The report of a comparison, whose searches are those of a run folder."""
    tables, stored, problem = comparison_tables(comparison), run.read_run(), comparison.problem
    shown = {table.name: table for table in tables}
    first, *others = [*shift_sentences(searches.sensor.shift), *verdict]
    composition = getattr(problem.composition, "value", problem.composition)
    played = (
        f"Every decider played the same live MuJoCo searches: {problem.num_objects} objects, composition "
        f"“{composition}”, touch cost λ = {problem.touch_cost}, seed {searches.seed}. A search succeeds if the decider "
        "confirms an object of the target shape, or rejects all objects when the target is absent. The return is +1 "
        "for a success, −1 otherwise, minus λ for each touch."
    )
    sections = [
        Section("", [first], folded={"Differences, bounds and stated confidence in words": others} if others else {}),
        Section("", [played]),
    ]
    if found := shown_searches(comparison):
        which = "The longest failure, or the longest search if none fails."
        if len(found) > 1:
            which = "The search in which two deciders differ most, with the same objects and equal touches."
        replayed = run.command("replay", folder=run.path, decider="NAME", target="SHAPE", number="N", out="search.png")
        words = (
            f"{which} The images were computed again from the episode's seed. Any other search, by its number: "
            f"`{replayed}` Bars: the belief about the object after the step; the target is orange."
        )
        films = [_story(searches, decider, episode) for decider, episode in found]
        sections.append(Section("One search, touch by touch", [words], films=films))
    for title, names in _SECTIONS.items():
        own = [shown[name] for name in names]
        if any(table.rows for table in own):
            sections.append(Section(title, (), own, pictures(comparison) if title == "Success" else []))
    if left_out := stored["arguments"].get("left_out"):
        sections.append(Section("Files that were left out", left_out))
    assert run.path is not None, "a report is of a folder"
    again = run.command("compare", config=run.path / "run.json")
    versions = ", ".join(f"{name} {version}" for name, version in stored["identity"]["versions"].items())
    text = json.dumps(stored, indent=1, sort_keys=True).replace("`", r"\u0060")
    made = [f"This command makes it again or continues it: `{again}`"]
    made.append(f"{versions}; commit {stored['commit'] or 'unknown'}.")
    sections.append(Section("How this was made", made, folded={"run.json": [f"`{text}`"]}))
    return Report(f"Searching by touch in the scene “{searches.scene_name}”", sections, ("tables", "figures"))


def shown_searches(comparison: Summary) -> list[tuple[str, Episode]]:
    """The same search by two deciders that touch, where they differ most: in success, else in touches.

    The first is the reference if it touches, the other the best of the rest by return. With a single decider that
    touches, or two that differ in no search: the longest failure, or the longest search if none fails.
    """
    names = [name for name in by_return(comparison) if any(episode.num_touches for episode in comparison.of(name))]
    if not names:
        return []
    first = comparison.reference if comparison.reference in names else names[0]
    rest = [name for name in names if name != first]

    def differing(two: tuple[Episode, Episode]) -> tuple[bool, int]:
        return two[0].success != two[1].success, abs(two[0].num_touches - two[1].num_touches)

    if rest:
        one, other = max(zip(comparison.of(first), comparison.of(rest[0]), strict=True), key=differing)
        if any(differing((one, other))):
            return [(first, one), (rest[0], other)]
    return [(first, max(comparison.of(first), key=lambda episode: (not episode.success, episode.num_touches)))]


def _story(searches: Searches, decider: str, episode: Episode) -> dict[str, Any]:
    """A search for the page: title, success, panels of decisions, and ``scale``, the value of the brightest colour.

    The scale is None for images in colour.
    """
    problem, labels = searches.problem, searches.problem.shape_labels
    verdict = "success" if episode.success else _FAILURES[episode.outcome]
    sought = f"{decider} searches for a {labels[episode.target]}"
    frames = replay(searches.sensor, problem, episode)
    largest = [int(frame.image.max()) for frame in frames if frame.image is not None and frame.image.ndim == 2]
    scale = max(1, *largest) if largest else None
    panels = [
        {
            "heading": f"object {frame.step.object_index + 1}, {body_words(labels, frame.shape)}",
            "action": action_words(frame.step.decision.action, problem),
            "picture": None if frame.image is None else _picture(frame.image, scale),
            "bars": [
                (labels[k], float(frame.posterior[k]), k == episode.target)
                for k in shown_shapes(frame.posterior, episode.target)
            ],
            "scores": frame.step.decision.scores,
        }
        for frame in frames
    ]
    return {
        "title": f"{sought}: {verdict}, {episode.num_touches} touches (episode {episode.seed[-1]})",
        "success": bool(episode.success),
        "panels": panels,
        "scale": scale,
        "longest_label": max(map(len, labels)),
    }


def _picture(image: NDArray[np.uint8], scale: int | None) -> str:
    colours = image
    if image.ndim == 2:
        colours = (colormaps["magma"](image / (scale or 255))[:, :, :3] * 255).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(colours[::-1]).quantize(64).save(buffer, format="PNG", optimize=True)
    return data_uri(buffer.getvalue(), "image/png")
