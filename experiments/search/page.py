"""Report of a comparison: one HTML page with verdict, tables, figures and a few searches to step through."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from experiments.reporting.page import Section, data_uri, write_page
from experiments.search.figures import pictures
from experiments.search.play import Searches
from experiments.search.replay_figures import action_words, replay
from experiments.search.run import RunFolder
from experiments.search.summary import Summary
from experiments.search.tables import comparison_tables
from experiments.search.verdict import by_return
from experiments.sensor_choice import shift_sentences
from planners import Episode, Outcome

_SECTIONS = {"Success": ("results", "differences"), "Stated confidence": ("stated_confidence",), "Time": ("times",)}
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
    tables, drawn = comparison_tables(comparison), pictures(comparison)
    for table in tables:
        table.write_csv(folder / "tables" / f"{table.name}.csv")
    for picture in drawn:
        picture.write(folder / "figures")
    shown = {table.name: table for table in tables if table.rows}
    sections = [
        Section(title, (), [shown[name] for name in names if name in shown], drawn if title == "Success" else [])
        for title, names in _SECTIONS.items()
    ]
    stories = [_story(searches, decider, episode) for decider, episode in shown_searches(comparison)]
    write_page(
        path,
        f"Searching by touch in the scene “{searches.scene_name}”",
        [section for section in sections if section.tables],
        "report.html",
        comparison=comparison,
        composition=getattr(comparison.problem.composition, "value", comparison.problem.composition),
        verdict=[*shift_sentences(searches.sensor.shift), *verdict],
        stories=stories,
        run=run.read_run(),
        again=run.command("compare", config=folder / "run.json"),
        replay=run.command("replay", folder=folder, decider="NAME", target="SHAPE", number="N", out="search.png"),
        before=["One search, touch by touch"] * bool(stories),
        also=["How this was made"],
        seed=searches.seed,
        longest_label=max(map(len, comparison.problem.shape_labels)),
    )
    return path


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
    problem, labels = searches.problem, searches.problem.shape_labels
    verdict = "success" if episode.success else _FAILURES[episode.outcome]
    sought = f"{decider} searches for a {labels[episode.target]}"
    frames = replay(searches.sensor, problem, episode)
    largest = [int(frame.image.max()) for frame in frames if frame.image is not None and frame.image.ndim == 2]
    scale = max(1, *largest) if largest else None
    panels = [
        {
            "heading": f"object {frame.step.object_index + 1}, a {labels[frame.shape]}",
            "action": action_words(frame.step.decision.action, problem),
            "picture": None if frame.image is None else _picture(frame.image, scale),
            "bars": [(labels[k], float(prob), k == episode.target) for k, prob in enumerate(frame.posterior)],
            "scores": frame.step.decision.scores,
        }
        for frame in frames
    ]
    return {
        "title": f"{sought}: {verdict}, {episode.num_touches} touches (episode {episode.seed[-1]})",
        "success": bool(episode.success),
        "panels": panels,
        "scale": scale,
    }


def _picture(image: NDArray[np.uint8], scale: int | None) -> str:
    colours = image
    if image.ndim == 2:
        colours = (colormaps["magma"](image / (scale or 255))[:, :, :3] * 255).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(colours[::-1]).quantize(64).save(buffer, format="PNG", optimize=True)
    return data_uri(buffer.getvalue(), "image/png")
