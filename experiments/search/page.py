"""Report of a comparison: its figures, and one HTML page with verdict, tables and a few searches to step through."""

from __future__ import annotations

import io
import json
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps, rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from numpy.typing import NDArray
from PIL import Image

from activetouch import Scene, TactileSensor
from activetouch.distributions import Constant
from activetouch.poses import Placement, WorldObject
from activetouch.pressing.contact import Quasistatic
from activetouch.view import Bodies, coloured, press_picture
from belief.naming import shape_name
from belief.problem import Probe, SearchProblem
from belief.validation import Floats
from experiments.report import Picture, Report, Section, data_uri
from experiments.search.play import Moment, Searches, action_words, body_words, moments, shown_shapes
from experiments.search.run import RunFolder
from experiments.search.summary import ALL, Cell, Summary
from experiments.search.verdict import (
    answer_sentences,
    by_return,
    called,
    comparison_tables,
    detail_sentences,
    why_failed,
)
from experiments.sensor_choice import shift_sentences
from planners import Episode

_WIDTH = 5.2  # inches; narrow, so that text stays readable on a phone
_MARKERS = "osD^vP*X"


def pictures(comparison: Summary) -> list[Picture]:
    """All figures of a comparison; the first goes with the answer."""
    num_deciders, num_groups = len(comparison.deciders), len(comparison.targets) + 1
    return [
        Picture(name, caption, [partial(FIGURES[name], comparison)], size=size)
        for name, caption, size in (
            ("answer", _ANSWER, (_WIDTH + 0.8, 0.55 + 0.32 * num_deciders)),
            ("success", _SUCCESS, (_WIDTH, 1.0 + num_groups * (0.16 * num_deciders + 0.16))),
            ("frontier", _FRONTIER, (_WIDTH, 3.4)),
        )
    ]


def draw_answer(comparison: Summary, axes: Axes) -> None:
    """Draw, for each decider, a bar of the searches that are right, and beside it one of the touches per search."""
    names, ink, beside = by_return(comparison), rcParams["text.color"], 1.5  # where bars of touches begin
    cells = [comparison.cells[name, ALL] for name in names]
    longest = max(1.0, *(cell.touches for cell in cells))
    for place, (name, cell) in enumerate(zip(names, cells, strict=True)):
        colour, (low, high) = f"C{comparison.deciders.index(name)}", cell.success_interval
        touches = 0.6 * cell.touches / longest
        axes.barh(place, cell.success, 0.6, color=colour)
        axes.plot([low, high], [place, place], color=ink, linewidth=1)
        axes.text(1.04, place, f"{cell.successes} of {cell.num_episodes}", va="center", in_layout=False)
        axes.barh(place, touches, 0.6, left=beside, color=colour)
        axes.text(beside + touches + 0.03, place, f"{cell.touches:.1f}", va="center", in_layout=False)
    axes.vlines(comparison.no_touch_baseline, -0.5, len(names) - 0.5, color=ink, linestyle=":", linewidth=1)
    for x, title in ((0.0, "searches that are right"), (beside, "touches per search")):
        axes.text(x, -0.6, title, va="bottom", weight="bold", in_layout=False)
        axes.vlines(x, -0.5, len(names) - 0.5, color=ink, linewidth=0.8)
    axes.set(xlim=(0, beside + 0.8), ylim=(len(names) - 0.5, -1.0), xticks=[], yticks=range(len(names)))
    axes.set_yticklabels([textwrap.fill(called(comparison)[name], 28) for name in names])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


_ANSWER = (
    "Searches that are right, with 95 % Wilson intervals, and touches per search. The dotted line is the best guess "
    "without a touch."
)
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
    {"answer": draw_answer, "success": draw_success, "frontier": draw_frontier}
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


def report_of(run: RunFolder, comparison: Summary, searches: Searches, with_searches: bool = True) -> Report:
    """The report of a comparison, whose searches are those of a run folder; with some of them to step through."""
    tables, stored, problem = comparison_tables(comparison), run.read_run(), comparison.problem
    shown = {table.name: table for table in tables}
    said, details = answer_sentences(comparison), detail_sentences(comparison)
    composition = getattr(problem.composition, "value", problem.composition)
    played = (
        f"Every decider played the same live MuJoCo searches: {problem.num_objects} objects, composition "
        f"“{composition}”, touch cost λ = {problem.touch_cost}, seed {searches.seed}. A search succeeds if the decider "
        "confirms an object of the target shape, or rejects all objects when the target is absent. The return is +1 "
        "for a success, −1 otherwise, minus λ for each touch."
    )
    folded = {"Returns, differences, intervals and stated confidence": details, "What was played": [played]}
    answer, *others = pictures(comparison)
    sections = [Section("", [*said, *shift_sentences(searches.sensor.shift)], [], [answer], folded)]
    if with_searches and (found := shown_searches(comparison)):
        replayed = run.command("replay", folder=run.path, decider="NAME", target="SHAPE", number="N", out="search.png")
        words = (
            f"{found.why} The images were computed again from the episode's seed. Any other search, by its number: "
            f"`{replayed}`"
        )
        legend = (
            "Bars: the belief about the object after the step; the target is orange. Bodies: each averaged over the "
            "orientations and sizes that are still possible, fainter if it is less probable; the line is the true one."
        )
        films = [
            story(searches.sensor, problem, _titled(called(comparison)[decider], episode, problem), episode)
            for decider, episode in found.searches
        ]
        sections.append(Section("One search, touch by touch", [words, legend], films=films))
    for title, names in _SECTIONS.items():
        own = [shown[name] for name in names]
        if any(table.rows for table in own):
            sections.append(Section(title, (), own, others if title == "Success" else []))
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


def _titled(decider: str, episode: Episode, problem: SearchProblem) -> str:
    """Title of a search."""
    ends = "success" if episode.success else f"fails, as it {why_failed(episode).words}"
    sought = f"{decider} searches for a {problem.shape_labels[episode.target]}"
    return f"{sought}: {ends}, {episode.num_touches} touches (episode {episode.seed[-1]})"


class Shown(NamedTuple):
    """Searches that a report shows, by decider, and a sentence on their choice."""

    searches: Sequence[tuple[str, Episode]]
    why: str


def shown_searches(comparison: Summary) -> Shown | None:
    """The same search by the best decider that touches and by the best that differs from it in success.

    Of these searches, the shortest that fails for the most frequent reason. Where no decider differs in success: the
    search where two differ most in touches. Where only one touches, or none differs: the longest failure, or search.
    """
    names = [name for name in by_return(comparison) if any(episode.num_touches for episode in comparison.of(name))]
    if not names:
        return None
    first, *rest = names
    pairs = {name: list(zip(comparison.of(first), comparison.of(name), strict=True)) for name in rest}
    for name, both in pairs.items():
        if differing := [pair for pair in both if pair[0].success != pair[1].success]:
            reasons = [why_failed(other if one.success else one).words for one, other in differing]
            [(reason, _)] = Counter(reasons).most_common(1)
            some = [pair for pair, words in zip(differing, reasons, strict=True) if words == reason]
            one, other = min(some, key=lambda pair: pair[0].num_touches + pair[1].num_touches)
            failing = called(comparison)[name if one.success else first]
            why = f"A search in which {failing} fails, for its most frequent reason there: it {reason}."
            return Shown([(first, one), (name, other)], f"{why} The objects are the same, and equal touches as well.")
    for name, both in pairs.items():
        one, other = max(both, key=lambda pair: abs(pair[0].num_touches - pair[1].num_touches))
        if one.num_touches != other.num_touches:
            why = "The search in which two deciders differ most, with the same objects and equal touches."
            return Shown([(first, one), (name, other)], why)
    longest = max(comparison.of(first), key=lambda episode: (not episode.success, episode.num_touches))
    return Shown([(first, longest)], "The longest failure, or the longest search if none fails.")


_MOST_DRAWN, _PORTRAITS = 40, 4  # steps with pictures of the scene and of bodies; bodies in each
_MOST_BARS, _LEAST_BAR = 6, 0.005  # shapes that are all shown, and the least probability of a shape among more
_SCENE = {"size": (300, 240), "oversampling": 1}  # of the picture of the scene
_BODIES = {"pixels": 84, "draws": 24}  # of the pictures of bodies


def story(sensor: TactileSensor, problem: SearchProblem, title: str, episode: Episode) -> dict[str, Any]:
    """A search for the page, in the form of ``film.html``; only the first steps of a long one have pictures of bodies.

    ``scale`` is the value of the brightest colour, None for images in colour; ``start`` the step that is shown first.
    Searches that are played ``together`` are at the same step.
    """
    labels, shown = problem.shape_labels, moments(sensor, problem, episode)
    scale = brightest([one.image for one in shown])
    drawn, panels = Drawn(sensor, scale), []
    for one in shown[:_MOST_DRAWN]:
        frame, action = one.frame, one.frame.step.decision.action
        pose = action.pose if isinstance(action, Probe) and frame.image is not None else None
        about = drawn.bodies_of(one.evidence, one.probs, pose, shape_name(labels, frame.shape), frame.body)
        seen = [*drawn.scene_of(one), *drawn.felt(one.image), *drawn.predicted(one.evidence, one.probs, pose)]
        panels.append(_panel(one, problem, episode.target, seen, about))
    for one in shown[_MOST_DRAWN:]:
        panels.append(_panel(one, problem, episode.target, drawn.felt(one.image), {}))
    return {
        "title": title,
        "success": bool(episode.success),
        "panels": panels,
        "scale": scale,
        "longest_label": max(map(len, labels)),
        "start": 0,
        "together": True,
    }


def _panel(
    moment: Moment, problem: SearchProblem, target: int, seen: Sequence[tuple[str, str]], bodies: Mapping[str, str]
) -> dict[str, Any]:
    frame, labels, probs = moment.frame, problem.shape_labels, moment.probs
    kept = shown_shapes(probs, target)
    if len(kept) > _MOST_BARS:
        kept = [k for k in kept if k == target or labels[k] in bodies or probs[k] >= _LEAST_BAR]
    return {
        "heading": f"object {frame.step.object_index + 1}, {body_words(labels, frame.shape)}",
        "action": action_words(frame.step.decision.action, problem),
        "words": moment.words,
        "seen": seen,
        "objects": moment.states,
        "now": frame.step.object_index,
        "bars": [(labels[k], float(probs[k]), k == target, bodies.get(labels[k])) for k in kept],
        "scores": frame.step.decision.scores,
    }


def brightest(images: Iterable[NDArray[np.uint8] | None]) -> int | None:
    """The largest value of some tactile images, at least 1; None for images in colour, or none at all."""
    largest = [int(image.max()) for image in images if image is not None and image.ndim == 2]
    return max(1, *largest) if largest else None


class Drawn:
    """Pictures of a step as URIs: the scene, what is felt, what probable bodies would feel like, and these bodies."""

    def __init__(self, sensor: TactileSensor, scale: int | None) -> None:
        self.sensor, self.scale = sensor, scale
        self.bodies = Bodies.of(sensor, **_BODIES)
        self._likeliest: tuple[Any, Floats, list[tuple[str, float, Floats]]] = None, np.zeros(0), []
        self._last: tuple[Placement | None, float, str] = None, 0.0, ""

    def scene_of(self, moment: Moment) -> list[tuple[str, str]]:
        """The object and the pad; after a decision, as they were at the touch before it."""
        scene, (placement, depth, uri) = self.sensor.scene, self._last
        if scene.hand is not None:
            return []
        if placement is not moment.placement or depth != moment.depth:
            around = scene.around(moment.placement.shape)
            image = press_picture(scene.pad, moment.placement, moment.depth, around, **_SCENE)
            uri = _uri(Image.fromarray(image), "webp", quality=80)
            self._last = moment.placement, moment.depth, uri
        return [("object and pad", uri)]

    def felt(self, image: NDArray[np.uint8] | None) -> list[tuple[str, str]]:
        """The image of the last touch."""
        return [] if image is None else [("felt", picture_uri(image, self.scale))]

    def predicted(self, evidence: Any, probs: Floats, pose: int | None, number: int = 2) -> list[tuple[str, str]]:
        """What the most probable bodies of a belief about many would feel like in a pose, as they most probably lie."""
        scene, bodies = self._exact, self.bodies
        if pose is None or bodies is None or scene is None:
            return []
        found = []
        for shape in np.argsort(-probs, kind="stable")[:number].tolist():
            label = self.sensor.shape_labels[shape]
            rest, size = bodies.best(evidence, label)
            pressed = scene.press(WorldObject(shape, size, rest), pose, np.random.default_rng(0))
            found.append((f"expected of {label}", picture_uri(pressed.image, self.scale)))
        return found

    @cached_property
    def _exact(self) -> Scene | None:
        """The scene without offsets, noise and simulated time; None where touches are not of many bodies."""
        scene = self.sensor.scene
        if scene.hand is not None or not hasattr(self.sensor.model, "strangers"):
            return None
        centred = replace(scene.variation, offset=Constant(0.0))
        return replace(scene, variation=centred, press_model=Quasistatic(), faults=())

    def bodies_of(
        self, evidence: Any, probs: Floats, pose: int | None, true_label: str, body: WorldObject | None
    ) -> dict[str, str]:
        """Likely bodies by label, each averaged over what is possible, with the outline of the true one.

        In beliefs about many bodies, a ring marks where the pad meets it.
        """
        if self.bodies is None or evidence is None:
            return {}
        about, believed, likeliest = self._likeliest
        if about is not evidence or not np.array_equal(believed, probs):  # a decision has those of the touch before it
            likeliest = self.bodies.likeliest(evidence, probs, _PORTRAITS)
            self._likeliest = evidence, probs, likeliest
        found = {}
        for label, prob, picture in likeliest:
            pixels = coloured(picture, prob)
            if body is not None and label == true_label:
                _draw_outline(pixels, self.bodies.outline(label, body))
            if pose is not None and self._exact is not None:
                rest, size = self.bodies.best(evidence, label)
                world_object = WorldObject(self.sensor.shape_labels.index(label), size, rest)
                placed = self._exact.place(world_object, pose, np.random.default_rng(0))
                _draw_ring(pixels, *self.bodies.touched(label, rest, size, placed.orientation))
            found[label] = _uri(Image.fromarray((255 * pixels[::-1]).round().astype(np.uint8)), "webp", quality=80)
        return found


def _draw_outline(pixels: NDArray[np.float64], covered: NDArray[np.float64]) -> None:
    """Draw the edge of what is covered."""
    inside = np.pad(covered > 0.5, 1)
    around = inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    pixels[inside[1:-1, 1:-1] & ~around] = _OUTLINE


def _draw_ring(pixels: NDArray[np.float64], row: float, column: float, is_seen: bool) -> None:
    """Draw a ring about a point, fainter if the point is on the far side."""
    rows, columns = np.indices(pixels.shape[:2])
    ring = np.abs(np.hypot(rows - row, columns - column) - _RADIUS) < 0.8
    pixels[ring] = (*_RING, 1.0 if is_seen else 0.35)


_OUTLINE, _RING = (0.0, 0.62, 0.45, 1.0), (0.9, 0.32, 0.0)
_RADIUS = 4.5  # of a ring [pixels]


def picture_uri(image: NDArray[np.uint8], scale: int | None) -> str:
    """A tactile image as a URI; row 0 is at the bottom."""
    colours = image
    if image.ndim == 2:
        colours = (colormaps["magma"](image / (scale or 255))[:, :, :3] * 255).astype(np.uint8)
    return _uri(Image.fromarray(colours[::-1]).quantize(64), "png", optimize=True)


def _uri(picture: Image.Image, kind: str, **how: Any) -> str:
    buffer = io.BytesIO()
    picture.save(buffer, format=kind, **how)
    return data_uri(buffer.getvalue(), f"image/{kind}")
