"""One self-contained HTML page for a comparison: table, figures, and a few searches picture by picture."""

from __future__ import annotations

import base64
import io
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from activetouch.atomic import write_text
from belief import SearchProblem
from experiments.episodes import Setting
from experiments.figures import success_figure, time_figure, touches_figure
from experiments.replay import Frame, action_words, replay
from experiments.results import RunFolder
from experiments.summary import Comparison
from planners import Episode, Outcome

_REPLAYS_PER_DECIDER = 2
_FAILURES = {
    Outcome.CONFIRMED: "confirmed the wrong object",
    Outcome.EXHAUSTED: "rejected everything",
    Outcome.TRUNCATED: "ran out of touches",
}


def write_report(folder: Path, comparison: Comparison, setting: Setting, seed: int) -> Path:
    """Write ``report.html`` into the run's folder and return its path."""
    environment = Environment(
        loader=PackageLoader("experiments"), undefined=StrictUndefined, autoescape=True, trim_blocks=True
    )
    html = environment.get_template("report.html").render(
        comparison=comparison,
        figures=[success_figure(comparison), touches_figure(comparison), time_figure(comparison)],
        stories=[_story(setting, name, episode) for name, episode in _choose(comparison)],
        run=RunFolder(folder).read_run(),
        seed=seed,
        scene=setting.choice.scene,
        longest_label=max(map(len, comparison.problem.shape_labels)),
    )
    path = folder / "report.html"
    write_text(path, html)
    return path


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


def _choose(comparison: Comparison) -> list[tuple[str, Episode]]:
    """For each decider that touches: its longest failure if it has one, and a success among its longer ones."""
    chosen = []
    for decider in comparison.deciders:
        episodes = list(
            itertools.chain.from_iterable(comparison.episodes[decider, target] for target in comparison.targets)
        )
        touched = sorted((e for e in episodes if e.num_touches), key=lambda e: e.num_touches)
        failures = [e for e in touched if not e.success]
        successes = [e for e in touched if e.success]
        picks = failures[-1:] + successes[-len(successes) // 4 :][:_REPLAYS_PER_DECIDER]
        chosen += [(decider, episode) for episode in picks[:_REPLAYS_PER_DECIDER]]
    return chosen


def _story(setting: Setting, decider: str, episode: Episode) -> Story:
    problem = setting.problem
    labels = problem.shape_labels
    verdict = "found it" if episode.success else _FAILURES[episode.outcome]
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
        picture=None if frame.image is None else _data_uri(frame.image),
        bars=bars,
        scores=[(name, f"{value:.3f}") for name, value in frame.step.decision.scores.items()],
    )


def _data_uri(image: NDArray[np.uint8]) -> str:
    colours = image if image.ndim == 3 else (colormaps["magma"](image)[:, :, :3] * 255).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(colours[::-1]).quantize(64).save(buffer, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
