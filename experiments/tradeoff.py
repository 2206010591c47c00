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
    from experiments.tradeoff_measure import Result, TouchCost
    from experiments.tradeoff_picks import Front, Pick, Point


@dataclass(frozen=True)
class Tradeoff:
    """Measure what speed costs in accuracy, draw the front, and name the configurations to take.

    One thing at a time is other than in a scene's default: the decider, the touch cost, the network, its precision, the
    observation model, the fidelity. All configurations of a scene play the same live searches. Observation models of
    other networks and kinds are fitted to recorded touches (activetouch collect --plan.repeats 6 --out
    data/SCENE-repeats); without these they are left out. Results are kept by configuration: interrupt it whenever you
    like, the same command goes on from there.

    For example:

        activetouch tradeoff
        activetouch tradeoff --scenes coarse --episodes 50
        activetouch tradeoff --checkpoints gel=runs/train-gel-tiny-32/classifier.safetensors
    """

    scenes: tuple[str, ...] = tuple(SCENES)
    """Which scenes."""
    checkpoints: tuple[str, ...] = ()
    """Further classifiers, of other backbones or resolutions, each as SCENE=FILE."""
    episodes: int = 200
    """Searches for each target of gel; fewer in scenes that take longer."""
    success: float = 0.98
    """Success that is good enough."""
    milliseconds: float = 50.0
    """Time of a touch that is fast enough."""
    seed: int = 0
    """Of the episodes and intervals."""
    out: Path = Path("runs/tradeoff")
    """Folder for results, report.html, tradeoff.json, tradeoff.md, tradeoff.csv and figure."""
    finished: bool = False
    """Measure nothing: report on all results that the folder holds by now, whatever sweeps they are of."""
    jobs: int = 1
    """Processes; the results do not depend on it."""

    def run(self) -> None:
        """Measure what is missing, then pick, write and print.

        Raises:
            BadArgument: there is nothing to do, or a checkpoint is not named as SCENE=FILE.
            UnknownName: there is no such scene.
        """
        from experiments.tradeoff_measure import finished
        from experiments.tradeoff_picks import Point, fronts, picks

        for scene in self.scenes:
            named_scene(scene)
        if self.episodes < 1 or self.jobs < 1 or not self.scenes:
            raise BadArgument("--episodes and --jobs must be at least 1, and --scenes must name one")
        results = finished(self.out) if self.finished else self.measure()
        if not results:
            raise BadArgument(f"{self.out} holds no results yet; leave out --finished to measure some")
        found = fronts([Point(*result) for result in results], np.random.default_rng(self.seed))
        answers = {front.task: picks(front, self.success, self.milliseconds) for front in found}
        self._write(found, answers)

    def measure(self) -> list[tuple[Result, TouchCost]]:
        """All configurations with their results and costs."""
        from experiments.tradeoff_configuration import Network, sweep
        from experiments.tradeoff_measure import measured

        networks = [Network.of(scene) for scene in dict.fromkeys(self.scenes)]
        for checkpoint in self.checkpoints:
            scene, _, file = checkpoint.partition("=")
            if scene not in self.scenes or not file:
                raise BadArgument(
                    f"--checkpoints are SCENE=FILE with a scene of {', '.join(self.scenes)}; got {checkpoint!r}"
                )
            networks.append(Network.of(scene, Path(file)))
        calibrated = [scene for scene in self.scenes if (repeats_folder(scene) / "manifest.json").exists()]
        configurations = sweep(networks, calibrated, self.episodes, self.seed)
        tasks = [partial(measured, c, self.out) for c in configurations]
        return list(run_tasks(tasks, self.jobs, "searching"))

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
