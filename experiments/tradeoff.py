"""``activetouch tradeoff``: what speed costs in accuracy, over sensors, networks, observation models and deciders."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from activetouch.atomic import write_text
from activetouch.scenes import SCENES
from experiments.compare import BadArgument
from experiments.parallel import run_tasks
from experiments.scene_choice import named_scene, repeats_folder

if TYPE_CHECKING:
    from experiments.study import Grid
    from experiments.tradeoff_configuration import Configuration, Network
    from experiments.tradeoff_measure import Result, TouchCost
    from experiments.tradeoff_picks import Front, Pick, Point


@dataclass(frozen=True)
class Tradeoff:
    """Measure what speed costs in accuracy, draw the front, and name the configurations to take.

    One thing at a time is other than in a scene's default: the network, its precision, the observation model, the
    decider, the touch cost, the fidelity. Searches are on recorded touches of unseen objects where a collection with
    several rounds is there (activetouch collect --plan.repeats 6 --out data/SCENE-repeats), and live otherwise. Results
    are kept by configuration: interrupt it whenever you like, the same command goes on from there.

    For example:

        activetouch tradeoff
        activetouch tradeoff --scenes coarse --episodes 50
        activetouch tradeoff --scenes gel --checkpoints runs/train-gel-tiny-32/classifier.safetensors
    """

    scenes: tuple[str, ...] = tuple(SCENES)
    """Which scenes."""
    checkpoints: tuple[Path, ...] = ()
    """Further classifiers for the scene gel, of other backbones or resolutions."""
    episodes: int = 250
    """Searches per target of a scene of four shapes; fewer of larger scenes, and a tenth of that live."""
    success: float = 0.98
    """Success that is good enough."""
    milliseconds: float = 50.0
    """Time of a touch that is fast enough."""
    seed: int = 0
    """Of the episodes and intervals."""
    out: Path = Path("runs/tradeoff")
    """Folder for results, report.html, tradeoff.json, tradeoff.md, tradeoff.csv and figure."""
    recorded: bool = True
    """Whether to search on recorded touches where there are some; else live only, and fewer configurations."""
    finished: bool = False
    """Measure nothing: report on all results that the folder holds by now, whatever sweeps they are of."""
    jobs: int = 1
    """Processes; the results do not depend on it."""

    def run(self) -> None:
        """Measure what is missing, then pick, write and print."""
        from experiments.tradeoff_measure import finished
        from experiments.tradeoff_picks import Point, fronts, picks

        for scene in self.scenes:
            named_scene(scene)
        if self.episodes < 1 or self.jobs < 1 or not self.scenes:
            raise BadArgument("--episodes and --jobs must be at least 1, and --scenes must name one")
        measured = finished(self.out) if self.finished else self.measure()
        points = [Point(result, cost) for result, cost in measured]
        if not points:
            raise BadArgument(f"{self.out} holds no results yet; leave out --finished to measure some")
        found = fronts(points, np.random.default_rng(self.seed))
        answers = {front.task: picks(front, self.success, self.milliseconds) for front in found}
        self._write(found, answers)

    def measure(self) -> list[tuple[Result, TouchCost]]:
        """All configurations with their results and costs."""
        from experiments.tradeoff_configuration import Network, sweep
        from experiments.tradeoff_measure import measured, touch_cost

        networks = [Network.of(scene) for scene in self.scenes]
        networks += [Network.of("gel", path) for path in self.checkpoints if "gel" in self.scenes]
        recorded = [scene for scene in self.scenes if self.recorded and _has_test_objects(scene)]
        configurations = sweep(networks, recorded, self.episodes, self.seed)
        costs = {c.key: touch_cost(c, self.out) for c in configurations}
        self._read(configurations)
        tasks = [partial(measured, c, self.out) for c in configurations]
        results = {result.configuration.key: result for result in run_tasks(tasks, self.jobs, "searching")}
        return [(results[c.key], costs[c.key]) for c in configurations]

    def _read(self, configurations: Sequence[Configuration]) -> None:
        """Read the recorded touches by every network once, before processes could do so twice."""
        from experiments.tradeoff_touches import read_rounds

        read: set[tuple[Network, str]] = set()
        for c in configurations:
            if c.touches == "recorded" and (c.network, c.precision) not in read:
                read.add((c.network, c.precision))
                for split in ("calibration", "test"):
                    read_rounds(c.network, c.precision, split, self.out / "touches")

    def _write(self, found: Sequence[Front], answers: dict[str, list[Pick]]) -> None:
        from experiments.page import Part, write_csv, write_page
        from experiments.tradeoff_figures import front_figure, inline, write_figure

        figure = front_figure(found)
        write_figure(figure, self.out / "tradeoff.svg")
        grids = [_grid(front) for front in found]
        sentences = [line for task, some in answers.items() for line in self._sentences(task, some)]
        caption = (
            "Every point is a configuration, with its 95 % Wilson interval; the larger, the more often it is on the "
            "front when the searches are resampled. The dashed line is the front."
        )
        parts = [Part("What to take", sentences, figures=[(inline(figure), caption)])]
        parts += [Part(front.task.capitalize(), [], [grid]) for front, grid in zip(found, grids, strict=True)]
        write_page(self.out / "report.html", "What speed costs in accuracy", parts)
        rows = [row for grid in grids for row in grid.rows]
        write_csv(self.out / "tradeoff.csv", type(grids[0])("", grids[0].headings, rows))
        short = [_grid(front, only_front=True) for front in found]
        text = ["\n".join(f"- {line}" for line in sentences), *(grid.markdown() for grid in [*short, *grids])]
        write_text(self.out / "tradeoff.md", "\n\n".join(text) + "\n")
        points = [_entry(point, prob) for front in found for point, prob in zip(front.points, front.probs, strict=True)]
        arguments = {k: [str(x) for x in v] if isinstance(v, tuple) else v for k, v in asdict(self).items()}
        numbers = {"arguments": {**arguments, "out": str(self.out)}, "points": points, "answers": sentences}
        write_text(self.out / "tradeoff.json", json.dumps(numbers, indent=1) + "\n")
        console = Console()
        for grid in short:
            console.print(grid.rich())
        for line in sentences:
            console.print(line, soft_wrap=True, markup=False, highlight=False)
        print(f"wrote {self.out}/report.html, tradeoff.md, .json, .csv and .svg")

    def _sentences(self, task: str, some: Sequence[Pick]) -> list[str]:
        from experiments.tradeoff_measure import export_sensor

        lines = []
        for pick in some:
            if pick.point is None:
                lines.append(f"{task}, {pick.question}: none of these.")
                continue
            p = pick.point
            sensor = export_sensor(p.configuration, self.out)
            low, high = p.interval
            lines.append(
                f"{task}, {pick.question}: {p.configuration.name}. Success {p.success:.3f} [{low:.3f}, {high:.3f}] of "
                f"{p.num_searches}, {p.touches:.2f} touches and {p.ms_per_search:.1f} ms a search, "
                f"{p.ms_per_touch:.2f} ms a touch. Play it: {p.configuration.command(sensor)}"
            )
        return lines


def _has_test_objects(scene: str) -> bool:
    """Whether the scene's repeated touches are recorded, the test split included."""
    return (repeats_folder(scene) / "manifest.json").exists() and (repeats_folder(scene) / "test").is_dir()


def _grid(front: Front, only_front: bool = False) -> Grid:
    from experiments.study import Grid

    headings = (
        "configuration",
        "searches",
        "success",
        "95 %",
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
    rows = [
        (
            p.configuration.name,
            str(p.num_searches),
            f"{p.success:.3f}",
            f"{p.interval[0]:.3f}–{p.interval[1]:.3f}",
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
        for p, on, prob in zip(front.points, front.on_front, front.probs, strict=True)
        if on or not only_front
    ]
    return Grid(f"{front.task}: the front" if only_front else front.task, headings, rows)


def _entry(point: Point, prob: float) -> dict[str, object]:
    c = point.configuration
    return {
        "name": c.name,
        "key": c.key,
        "configuration": asdict(c),
        "searches": point.num_searches,
        "success": point.success,
        "interval": point.interval,
        "touches": point.touches,
        "return": point.reward,
        "ms_per_search": point.ms_per_search,
        "ms_per_decision": point.result.ms_per_decision,
        **asdict(point.cost),
        "prob_on_front": float(prob),
    }
