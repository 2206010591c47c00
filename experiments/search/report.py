"""One self-contained HTML page for a comparison: verdict, tables, figures, and a few searches to step through."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from belief import SearchProblem
from belief.files import write_text
from experiments.search.figures import Picture, pictures
from experiments.search.replay import Frame, action_words, replay
from experiments.search.run_folder import RunFolder
from experiments.search.setting import Setting
from experiments.search.summary import Comparison
from experiments.search.tables import Sheet, sheets
from experiments.search.verdict import verdict
from experiments.sensor_choice import shift_sentences
from planners import Episode, Outcome

_MOST_BYTES = 3_500_000  # of all searches shown, so that the page stays below 5 MB
_SECTIONS = {
    "Success": (("success", "frontier"), ("results", "differences", "returns")),
    "Where the target lay": (("positions",), ("positions",)),
    "Touches": (("touches",), ("touches",)),
    "Promised and kept": (("promises",), ("promises", "claims")),
    "Time": (("times",), ("times",)),
}
_FAILURES = {
    Outcome.CONFIRMED: "confirmed the wrong object",
    Outcome.EXHAUSTED: "rejected everything",
    Outcome.TRUNCATED: "ran out of touches",
}


def environment() -> Environment:
    """Where templates are."""
    return Environment(
        loader=PackageLoader("experiments.reporting"), undefined=StrictUndefined, autoescape=True, trim_blocks=True
    )


def write_report(folder: Path, comparison: Comparison, setting: Setting, seed: int, told: Sequence[str] = ()) -> Path:
    """Write ``report.html``, ``figures/`` and ``tables/`` into the run's folder; return the path of the page.

    Args:
        folder: of the run.
        comparison: what to tell.
        setting: of the run.
        seed: of the run.
        told: sentences about what else the folder holds.
    """
    drawn = {picture.name: picture for picture in pictures(comparison)}
    tables = {sheet.name: sheet for sheet in sheets(comparison)}
    for picture in drawn.values():
        picture.write(folder / "figures")
    for sheet in tables.values():
        write_text(folder / "tables" / f"{sheet.name}.csv", sheet.csv())
    stories, left_out = _stories(setting, comparison)
    html = (
        environment()
        .get_template("report.html")
        .render(
            comparison=comparison,
            composition=getattr(comparison.problem.composition, "value", comparison.problem.composition),
            verdict=[*shift_sentences(setting.shift), *verdict(comparison)],
            sections=[_section(title, *names, drawn, tables) for title, names in _SECTIONS.items()],
            stories=stories,
            left_out=left_out,
            run=RunFolder(folder).read_run(),
            seed=seed,
            told=told,
            scene=setting.choice.scene,
            longest_label=max(map(len, comparison.problem.shape_labels)),
        )
    )
    path = folder / "report.html"
    write_text(path, html)
    return path


@dataclass(frozen=True)
class Section:
    """A part of the page: figures, and tables each with its CSV."""

    title: str
    pictures: Sequence[Picture]
    sheets: Sequence[tuple[Sheet, str]]


def _section(
    title: str, figures: Sequence[str], names: Sequence[str], drawn: dict[str, Picture], tables: dict[str, Sheet]
) -> Section:
    found = [tables[name] for name in names if tables[name].rows]
    return Section(title, [drawn[name] for name in figures], [(sheet, csv_link(sheet)) for sheet in found])


def csv_link(sheet: Sheet) -> str:
    """A table as the address of a download that needs no network."""
    return _data_uri("text/csv", sheet.csv().encode())


@dataclass(frozen=True)
class Panel:
    """One decision as the page shows it."""

    heading: str
    action: str
    picture: str | None
    bars: list[tuple[str, float, bool]]
    scores: list[tuple[str, str]]


@dataclass(frozen=True)
class Story:
    """One search as the page shows it."""

    title: str
    success: bool
    panels: list[Panel]

    @property
    def num_bytes(self) -> int:
        """What its images add to the page, about."""
        return sum(len(panel.picture or "") + 600 for panel in self.panels)


def _stories(setting: Setting, comparison: Comparison) -> tuple[list[Story], list[str]]:
    """The searches to show, and the titles of those that the page has no room for."""
    stories, left_out, total = [], [], 0
    for decider, episode in choose(comparison):
        story = _story(setting, decider, episode)
        if total + story.num_bytes > _MOST_BYTES:
            left_out.append(story.title)
            continue
        total += story.num_bytes
        stories.append(story)
    return stories, left_out


def choose(comparison: Comparison) -> list[tuple[str, Episode]]:
    """For each decider that touches: its longest failure, a success of median length, and its longest search."""
    chosen = []
    for decider in comparison.deciders:
        touched = sorted((e for e in comparison.of(decider) if e.num_touches), key=lambda e: e.num_touches)
        failures = [e for e in touched if not e.success]
        successes = [e for e in touched if e.success]
        picks = failures[-1:] + successes[len(successes) // 2 :][:1] + touched[-1:]
        chosen += [(decider, episode) for episode in dict.fromkeys(picks)]
    return chosen


def _story(setting: Setting, decider: str, episode: Episode) -> Story:
    problem = setting.problem
    labels = problem.shape_labels
    verdict = "right" if episode.success else _FAILURES[episode.outcome]
    number = episode.seed[-1]
    title = (
        f"{decider} looks for a {labels[episode.target]}: {verdict}, {episode.num_touches} touches (episode {number})"
    )
    panels = [_panel(problem, episode, frame) for frame in replay(setting, episode)]
    return Story(title, episode.success, panels)


def _panel(problem: SearchProblem, episode: Episode, frame: Frame) -> Panel:
    labels = problem.shape_labels
    bars = [(labels[k], float(prob), k == episode.target) for k, prob in enumerate(frame.posterior)]
    return Panel(
        heading=f"object {frame.step.object_index + 1}, a {labels[frame.shape]}",
        action=action_words(frame.step.decision.action, problem),
        picture=None if frame.image is None else _picture(frame.image),
        bars=bars,
        scores=[(name, f"{value:.3f}") for name, value in frame.step.decision.scores.items()],
    )


def _picture(image: NDArray[np.uint8]) -> str:
    colours = image if image.ndim == 3 else (colormaps["magma"](image)[:, :, :3] * 255).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(colours[::-1]).quantize(64).save(buffer, format="PNG", optimize=True)
    return _data_uri("image/png", buffer.getvalue())


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
