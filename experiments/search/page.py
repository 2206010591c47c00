"""Report of a comparison: one HTML page with verdict, tables, figures and a few searches to step through."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from belief.problem import SearchProblem
from experiments.reporting.page import Section, data_uri, write_page
from experiments.scene_choice import command
from experiments.search.figures import pictures
from experiments.search.play import Searches
from experiments.search.replay_figures import Frame, action_words, replay
from experiments.search.run import RunFolder
from experiments.search.summary import Summary
from experiments.search.tables import comparison_tables
from experiments.search.verdict import by_return
from experiments.sensor_choice import shift_sentences
from planners import Episode, Outcome

_SECTIONS = {
    "Success": ("results", "differences"),
    "Stated confidence": ("stated_confidence",),
    "Time": ("times",),
}
_FAILURES = {
    Outcome.CONFIRMED: "confirmed the wrong object",
    Outcome.EXHAUSTED: "rejected every object",
    Outcome.TRUNCATED: "reached the touch limit",
    Outcome.UNSURE: "answered “I do not know”",
}


def write_page_of(run: RunFolder, comparison: Summary, searches: Searches, verdict: Sequence[str]) -> Path:
    """Write ``report.html``, ``figures/`` and ``tables/`` into the folder of a run; return the path of the page.

    Raises:
        CannotWrite: The disk is full, or the folder is not writable.
    """
    assert run.path is not None, "a page is a file"
    folder, path = run.path, run.path / "report.html"
    for table in comparison_tables(comparison):
        table.write_csv(folder / "tables" / f"{table.name}.csv")
    stories = [_story(searches, decider, episode) for decider, episode in shown_searches(comparison)]
    write_page(
        path,
        f"Searching by touch in the scene “{searches.scene_name}”",
        _sections(comparison, folder),
        "report.html",
        comparison=comparison,
        composition=getattr(comparison.problem.composition, "value", comparison.problem.composition),
        verdict=[*shift_sentences(searches.sensor.shift), *verdict],
        stories=stories,
        run=run.read_run(),
        again=command("compare", config=folder / "run.json"),
        replay=command("replay", folder=folder, decider="NAME", target="SHAPE", number="N", out="search.png"),
        before=["One search, touch by touch"] * bool(stories),
        also=["How this was made"],
        seed=searches.seed,
        longest_label=max(map(len, comparison.problem.shape_labels)),
    )
    return path


def _sections(comparison: Summary, folder: Path) -> list[Section]:
    """Tables by section, below the figures, which are written into the folder, too."""
    drawn = pictures(comparison)
    for picture in drawn:
        picture.write(folder / "figures")
    shown = {table.name: table for table in comparison_tables(comparison) if table.rows}
    sections = [
        Section(title, (), [shown[name] for name in names if name in shown], drawn if title == "Success" else [])
        for title, names in _SECTIONS.items()
    ]
    return [section for section in sections if section.tables]


def shown_searches(comparison: Summary) -> list[tuple[str, Episode]]:
    """The same search by two deciders that touch, where they differ most: in success, else in touches.

    The first is the reference if it touches, the other the best of the rest by return. With a single decider that
    touches: its longest failure, or its longest search if it never fails.
    """
    names = [name for name in by_return(comparison) if any(episode.num_touches for episode in comparison.of(name))]
    if not names:
        return []
    first = comparison.reference if comparison.reference in names else names[0]
    rest = [name for name in names if name != first]
    if not rest:
        return [(first, max(comparison.of(first), key=lambda episode: (not episode.success, episode.num_touches)))]
    pairs = list(zip(comparison.of(first), comparison.of(rest[0]), strict=True))
    one, other = max(
        pairs, key=lambda two: (two[0].success != two[1].success, abs(two[0].num_touches - two[1].num_touches))
    )
    return [(first, one), (rest[0], other)]


def _story(searches: Searches, decider: str, episode: Episode) -> dict[str, Any]:
    """A search as the page shows it: title, success, values of a panel for each decision, and the scale of its images.

    The scale is the value that the brightest colour of the touch images stands for; None for images in colour.
    """
    problem = searches.problem
    verdict = "success" if episode.success else _FAILURES[episode.outcome]
    sought = f"{decider} searches for a {problem.shape_labels[episode.target]}"
    title = f"{sought}: {verdict}, {episode.num_touches} touches (episode {episode.seed[-1]})"
    frames = replay(searches.sensor, problem, episode)
    largest = [int(frame.image.max()) for frame in frames if frame.image is not None and frame.image.ndim == 2]
    scale = max(1, *largest) if largest else None
    panels = [_panel(problem, episode, frame, scale) for frame in frames]
    return {"title": title, "success": bool(episode.success), "panels": panels, "scale": scale}


def _panel(problem: SearchProblem, episode: Episode, frame: Frame, scale: int | None) -> dict[str, Any]:
    labels = problem.shape_labels
    bars = [(labels[k], float(prob), k == episode.target) for k, prob in enumerate(frame.posterior)]
    return {
        "alt": f"touch image; belief: {belief_in_words(bars)}",
        "heading": f"object {frame.step.object_index + 1}, a {labels[frame.shape]}",
        "action": action_words(frame.step.decision.action, problem),
        "picture": None if frame.image is None else _picture(frame.image, scale),
        "bars": bars,
        "scores": scores_in_words(frame.step.decision.scores),
    }


_SCORES = {
    "target_prob": "probability of the target",
    "value": "expected return",
    "value_confirm": "expected return of confirming",
    "value_reject": "expected return of rejecting",
}


def scores_in_words(scores: Mapping[str, float]) -> str:
    """The scores of a decision, as the page says them.

    >>> scores_in_words({"target_prob": 0.25, "gain_z45": 0.304, "gain_front": 0.3})
    'probability of the target 0.250; expected information [nats]: z45 0.304, front 0.300'
    """
    gains = [f"{name.removeprefix('gain_')} {value:.3f}" for name, value in scores.items() if name.startswith("gain_")]
    said = [
        f"{_SCORES.get(name, name.replace('_', ' '))} {value:.3f}"
        for name, value in scores.items()
        if not name.startswith("gain_")
    ]
    return "; ".join([*said, f"expected information [nats]: {', '.join(gains)}"] if gains else said)


def _picture(image: NDArray[np.uint8], scale: int | None = None) -> str:
    colours = image
    if image.ndim == 2:
        colours = (colormaps["magma"](image / (scale or 255))[:, :, :3] * 255).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(colours[::-1]).quantize(64).save(buffer, format="PNG", optimize=True)
    return data_uri(buffer.getvalue(), "image/png")


def belief_in_words(bars: Sequence[tuple[str, float, bool]]) -> str:
    """The two likeliest shapes of a belief.

    >>> belief_in_words([("cube", 0.7, False), ("cone", 0.3, True), ("ball", 0.0, False)])
    'cube 0.70, cone 0.30'
    """
    likeliest = sorted(bars, key=lambda bar: -bar[1])[:2]
    return ", ".join(f"{label} {prob:.2f}" for label, prob, _ in likeliest)
