"""Report of a comparison: one HTML page with cards, verdict, tables, figures and a few searches to step through."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from belief.problem import SearchProblem
from experiments.reporting.page import Section, data_uri, write_page
from experiments.search.body_picture import Bodies
from experiments.search.figures import pictures
from experiments.search.frames import Frame, action_words, replay
from experiments.search.play import Searches
from experiments.search.replay_figures import coloured
from experiments.search.run_folder import RunFolder
from experiments.search.summary import Summary
from experiments.search.tables import comparison_tables
from experiments.search.verdict import by_return, cards, short_names
from experiments.sensor_choice import shift_sentences
from experiments.sensor_commands import command
from planners import Episode, Outcome

_MOST_BYTES = 3_500_000  # of all displayed searches, to keep the page below 5 MB
_SECTIONS = {
    "Success": (("success", "frontier"), ("results", "differences", "returns")),
    "Position of the target": (("positions",), ("positions",)),
    "Touches": (("touches",), ("touches", "overprobing")),
    "Calibration at stopping": (("stated_confidence",), ("stated_confidence", "calibration_at_stopping")),
    "Answers and “I do not know”": (("selective_risk",), ("abstention", "selective_risk")),
    "Time": (("times",), ("times",)),
}
_PRESSED = 0.2  # of the brightest pixel
_ROWS, _COLUMNS = ("bottom", "middle", "top"), ("left", "centre", "right")
_FAILURES = {
    Outcome.CONFIRMED: "confirmed the wrong object",
    Outcome.EXHAUSTED: "rejected every object",
    Outcome.TRUNCATED: "reached the touch limit",
    Outcome.UNSURE: "answered “I do not know”",
}


def write_page_of(run: RunFolder, comparison: Summary, searches: Searches, verdict: Sequence[str]) -> Path:
    """Write ``report.html``, ``figures/`` and ``tables/`` into a run folder.

    Args:
        run: the folder, with its ``run.json``.
        comparison: results to report.
        searches: what determined the searches.
        verdict: sentences on the results.

    Returns:
        Path of the page.

    Raises:
        CannotWrite: The disk is full, or the folder is not writable.
    """
    assert run.path is not None, "a page is a file"
    folder, path = run.path, run.path / "report.html"
    for table in comparison_tables(comparison):
        table.write_csv(folder / "tables" / f"{table.name}.csv")
    comparison = comparison.renamed(short_names(comparison.deciders)[0])
    bodies = Bodies.of(searches.sensor, pixels=48, draws=24) if choose(comparison) else None
    duel = [_story(searches, decider, episode, bodies) for decider, episode in where_two_differ(comparison)]
    stories, left_out = _stories(searches, comparison, bodies, sum(story.num_bytes for story in duel))
    others = ["Some searches, touch by touch", "How this was made"]
    write_page(
        path,
        f"Searching by touch in the scene “{searches.scene_name}”",
        _sections(comparison, folder),
        "report.html",
        comparison=comparison,
        composition=getattr(comparison.problem.composition, "value", comparison.problem.composition),
        verdict=[*shift_sentences(searches.sensor.shift), *verdict],
        stories=stories,
        left_out=left_out,
        run=run.read_run(),
        again=command("compare", config=folder / "run.json"),
        replay=command("replay", folder=folder, decider="NAME", target="SHAPE", number="N", out="search.png"),
        cards=cards(comparison),
        duel=duel,
        also=["Two deciders on the same search", *others] if duel else others,
        seed=searches.seed,
        longest_label=max(map(len, comparison.problem.shape_labels)),
    )
    return path


def _sections(comparison: Summary, folder: Path) -> list[Section]:
    """Figures and tables by section; the figures are written into the folder, too."""
    drawn = {picture.name: picture for picture in pictures(comparison)}
    shown = {table.name: table for table in comparison_tables(comparison)}
    for picture in drawn.values():
        picture.write(folder / "figures")
    sections = [
        Section(
            title,
            (),
            [shown[name] for name in names if name in shown and shown[name].rows],
            [drawn[name] for name in figures if name in drawn],
        )
        for title, (figures, names) in _SECTIONS.items()
    ]
    return [section for section in sections if section.tables or section.pictures]


@dataclass(frozen=True)
class Story:
    """A search, as displayed on the page: title, whether it succeeded, and the values of a panel per decision."""

    title: str
    success: bool
    panels: list[dict[str, Any]]

    @property
    def num_bytes(self) -> int:
        """Approximate size on the page."""
        return sum(
            len(panel["picture"] or "") + len(panel["body"][1] if panel["body"] else "") + 600 for panel in self.panels
        )


def _stories(
    searches: Searches, comparison: Summary, bodies: Bodies | None, total: int
) -> tuple[list[Story], list[str]]:
    """Searches to display, and titles of those omitted to limit the size of the page, which has ``total`` bytes."""
    stories, left_out = [], []
    for decider, episode in choose(comparison):
        story = _story(searches, decider, episode, bodies)
        if total + story.num_bytes > _MOST_BYTES:
            left_out.append(story.title)
            continue
        total += story.num_bytes
        stories.append(story)
    return stories, left_out


def where_two_differ(comparison: Summary) -> list[tuple[str, Episode]]:
    """The same search by two deciders that touch, where they differ most: in success, else in touches.

    The first is the reference if it touches, the other the best of the rest by return. Empty without two of them.
    """
    names = [name for name in by_return(comparison) if any(episode.num_touches for episode in comparison.of(name))]
    first = comparison.reference if comparison.reference in names else next(iter(names), None)
    rest = [name for name in names if name != first]
    if first is None or not rest:
        return []
    pairs = list(zip(comparison.of(first), comparison.of(rest[0]), strict=True))
    one, other = max(
        pairs, key=lambda two: (two[0].success != two[1].success, abs(two[0].num_touches - two[1].num_touches))
    )
    return [(first, one), (rest[0], other)]


def choose(comparison: Summary) -> list[tuple[str, Episode]]:
    """Select the longest failure, a success of median length and the longest search of each decider that touches."""
    chosen = []
    for decider in comparison.deciders:
        touched = sorted((e for e in comparison.of(decider) if e.num_touches), key=lambda e: e.num_touches)
        failures = [e for e in touched if not e.success]
        successes = [e for e in touched if e.success]
        picks = failures[-1:] + successes[len(successes) // 2 :][:1] + touched[-1:]
        chosen += [(decider, episode) for episode in dict.fromkeys(picks)]
    return chosen


def _story(searches: Searches, decider: str, episode: Episode, bodies: Bodies | None) -> Story:
    problem = searches.problem
    verdict = "success" if episode.success else _FAILURES[episode.outcome]
    sought = f"{decider} searches for a {problem.shape_labels[episode.target]}"
    title = f"{sought}: {verdict}, {episode.num_touches} touches (episode {episode.seed[-1]})"
    panels = [_panel(problem, episode, frame, bodies) for frame in replay(searches.sensor, problem, episode)]
    return Story(title, episode.success, panels)


def _panel(problem: SearchProblem, episode: Episode, frame: Frame, bodies: Bodies | None) -> dict[str, Any]:
    labels, body = problem.shape_labels, None
    if bodies is not None and frame.evidence is not None and frame.image is not None:
        [(label, prob, picture)] = bodies.likeliest(frame.evidence, frame.posterior, 1)
        body = (label, _picture((255 * coloured(picture, prob)).astype(np.uint8)))
    bars = [(labels[k], float(prob), k == episode.target) for k, prob in enumerate(frame.posterior)]
    return {
        "body": body,
        "alt": "" if frame.image is None else f"{image_in_words(frame.image)}; belief: {belief_in_words(bars)}",
        "heading": f"object {frame.step.object_index + 1}, a {labels[frame.shape]}",
        "action": action_words(frame.step.decision.action, problem),
        "picture": None if frame.image is None else _picture(frame.image),
        "bars": bars,
        "scores": [(name, f"{value:.3f}") for name, value in frame.step.decision.scores.items()],
    }


def _picture(image: NDArray[np.uint8]) -> str:
    colours = image if image.ndim == 3 else (colormaps["magma"](image)[:, :, :3] * 255).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(colours[::-1]).quantize(64).save(buffer, format="PNG", optimize=True)
    return data_uri(buffer.getvalue(), "image/png")


def image_in_words(image: NDArray[np.uint8]) -> str:
    """How much of an image is pressed, and where it is brightest.

    Args:
        image: ``(H, W)`` or ``(H, W, 3)`` uint8; row 0 is at the bottom.

    >>> image_in_words(np.eye(4, dtype=np.uint8) * 200)
    '25 % of the image pressed, strongest at the bottom left'
    >>> image_in_words(np.zeros((4, 4), np.uint8))
    'nothing pressed'
    """
    bright = image.astype(float).mean(axis=2) if image.ndim == 3 else image.astype(float)
    bright = np.abs(bright - np.median(bright)) if image.ndim == 3 else bright
    if bright.max() == 0.0:
        return "nothing pressed"
    share = float((bright > _PRESSED * bright.max()).mean())
    row, column = np.unravel_index(int(bright.argmax()), bright.shape)
    place = f"{_ROWS[3 * int(row) // bright.shape[0]]} {_COLUMNS[3 * int(column) // bright.shape[1]]}"
    return f"{100 * share:.0f} % of the image pressed, strongest at the {place.replace('middle centre', 'centre')}"


def belief_in_words(bars: Sequence[tuple[str, float, bool]]) -> str:
    """The two likeliest shapes of a belief.

    >>> belief_in_words([("cube", 0.7, False), ("cone", 0.3, True), ("ball", 0.0, False)])
    'cube 0.70, cone 0.30'
    """
    likeliest = sorted(bars, key=lambda bar: -bar[1])[:2]
    return ", ".join(f"{label} {prob:.2f}" for label, prob, _ in likeliest)
