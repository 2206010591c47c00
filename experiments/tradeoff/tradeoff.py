"""``activetouch tradeoff``: speed against accuracy of sensors, presses and deciders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from activetouch import TactileSensor
from activetouch.named_scenes import SCENES
from belief.claims import claim_folder, ends_claims
from belief.errors import UnknownName
from experiments.command_line.arguments import (
    BadArgument,
    Count,
    Jobs,
    NotEmpty,
    Positive,
    Seed,
    Share,
    check_arguments,
)
from experiments.parallel import run_tasks
from experiments.tradeoff.configuration import SHARES, VARIED, Configuration, sweep

if TYPE_CHECKING:
    from experiments.tradeoff.measure import Measured


@dataclass(frozen=True)
class Tradeoff:
    """Measure the trade-off between speed and accuracy, draw the Pareto front and recommend configurations.

    A scene's default is its sensor of one rigid body with information gain. Every other configuration differs in one
    property: the decider, the touch cost, the sensor or the fidelity. All configurations of a scene play the same live
    searches. Sensors with other networks or numbers of hypotheses come from activetouch calibrate. Results are kept by
    configuration: after an interruption, the same command continues.

    For example:

        activetouch tradeoff
        activetouch tradeoff --scenes coarse --episodes 50
        activetouch tradeoff --scenes coarse --vary sensor --sensors coarse=runs/sensor-coarse-256
    """

    scenes: Annotated[tuple[str, ...], NotEmpty()] = tuple(SHARES)
    """Scenes to measure: gel, coarse, paper, hard or many."""
    sensors: tuple[str, ...] = ()
    """Sensors to measure as well, each as SCENE=FOLDER."""
    vary: tuple[Literal[VARIED], ...] = ()  # type: ignore[valid-type]
    """Properties to vary, such as sensor; all by default."""
    episodes: Count = 200
    """Searches for each target of gel; fewer in scenes that take longer."""
    success: Share = 0.98
    """Lowest acceptable success."""
    milliseconds: Positive = 50.0
    """Longest acceptable time per touch [ms]."""
    seed: Seed = 0
    """Seed of the episodes and intervals."""
    out: Path = Path("runs/tradeoff")
    """Folder for results, report.html, tradeoff.json, tradeoff.md, tradeoff.csv and the figure."""
    jobs: Jobs = 1
    """Number of processes; the results do not depend on it, except for the times."""

    @ends_claims
    def run(self) -> None:
        """Measure what is missing, then write and print the report.

        Raises:
            BadArgument: A sensor is not given as SCENE=FOLDER.
            LabelMismatch: A sensor knows other shapes than the scene has.
            UnknownName: There is no such scene.
        """
        from experiments.tradeoff.report import TradeoffReport  # loads jinja2

        check_arguments(self)
        for scene in self.scenes:
            if scene not in SHARES:
                raise UnknownName("scene of the trade-off", scene, list(SHARES))
        claim_folder(self.out)
        points = measure_all(self._configurations(), self.out, self.jobs)
        found = TradeoffReport(points, self.success, self.milliseconds)
        found.save(self.out)
        for table in found.short_tables():
            print(table, end="\n\n")
        for line in found.sentences():
            print(line)
        print(f"wrote {self.out}/report.html, tradeoff.md, .json, .csv, .svg and .png")

    def _configurations(self) -> list[Configuration]:
        sensors: dict[str, list[str]] = {}
        for given in self.sensors:
            scene, _, folder = given.partition("=")
            if scene not in self.scenes or not folder:
                raise BadArgument(
                    f"--sensors must be SCENE=FOLDER with a scene of {', '.join(self.scenes)}; got {given!r}"
                )
            TactileSensor.load(Configuration(scene, folder).folder, SCENES[scene].scene, anyway=True)
            sensors.setdefault(scene, []).append(folder)
        found = sweep(self.scenes, sensors, self.episodes, self.seed)
        return [c for c in found if not self.vary or c.varied in ("nothing", *self.vary)]


def measure_all(configurations: Sequence[Configuration], folder: Path, jobs: int = 1) -> list[Measured]:
    """Measure configurations; results in the folder are kept and read.

    Args:
        configurations: configurations to measure, such as those of :func:`experiments.tradeoff.configuration.sweep`.
        folder: folder of the results.
        jobs: number of processes.
    """
    from experiments.tradeoff.measure import measured  # loads MuJoCo

    tasks = [partial(measured, c, folder) for c in configurations]
    found = {result.configuration: result for result in run_tasks(tasks, jobs, "searching")}
    return [found[configuration] for configuration in configurations]
