"""``activetouch tradeoff``: speed against accuracy of sensors, presses and deciders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from activetouch import TactileSensor
from activetouch.named_scenes import SCENES
from activetouch.sensor_files import MODELS
from belief.constraints import NotEmpty, Positive, Share
from belief.errors import UnknownName
from belief.files import claim_folder, ends_claims, in_file_name
from experiments.command_line.arguments import BadArgument, Cluster, Count, Jobs, OnCluster, Seed, check_arguments
from experiments.scene_choice import SceneChoice
from experiments.tradeoff.report import SHARES, Configuration, Measured, TradeoffReport, sweep

_IN_FILES = ("searches", "minus default", "return", "physics", "network", "decision")
"""Columns for which a terminal is too narrow."""


@dataclass(frozen=True)
class Tradeoff:
    """Measure the trade-off between speed and accuracy, draw the Pareto front and recommend configurations.

    A scene's default is its sensor of one rigid body with information gain. Every other configuration differs in one
    property: the decider, the touch cost, the sensor or the fidelity. All configurations of a scene play the same live
    searches. Sensors with other networks or numbers of hypotheses come from activetouch calibrate. Searches are kept:
    after an interruption, the same command continues.

    For example:

        activetouch tradeoff
        activetouch tradeoff --scenes coarse --episodes 50
        activetouch tradeoff --scenes coarse --sensors coarse=runs/sensor-coarse-256
    """

    scenes: Annotated[tuple[str, ...], NotEmpty()] = tuple(SHARES)
    """Scenes to measure: gel, coarse, paper, hard or many."""
    sensors: tuple[str, ...] = ()
    """Sensors to measure as well, each as SCENE=FOLDER."""
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
    cluster: OnCluster = field(default_factory=Cluster)
    """Workers of other machines."""

    @ends_claims
    def run(self) -> None:
        """Measure what is missing, then write and print the report."""
        check_arguments(self)
        for scene in self.scenes:
            if scene not in SHARES:
                raise UnknownName("scene of the trade-off", scene, list(SHARES))
        claim_folder(self.out)
        points = measure_all(self._configurations(), self.episodes, self.seed, self.out / "searches", self.jobs)
        found = TradeoffReport(points, self.success, self.milliseconds)
        found.save(self.out)
        for table in found.tables():
            print(table.without(_IN_FILES), end="\n\n")
        for line in found.sentences():
            print(line)
        print(f"wrote {self.out}/report.html with all columns, tradeoff.md, .json, .csv, .svg and .png")

    def _configurations(self) -> list[Configuration]:
        sensors: dict[str, list[str]] = {}
        for given in self.sensors:
            scene, _, folder = given.partition("=")
            if scene not in self.scenes or not folder:
                raise BadArgument(
                    f"--sensors must be SCENE=FOLDER with a scene of {', '.join(self.scenes)}; got {given!r}"
                )
            shipped = MODELS / folder
            TactileSensor.load(shipped if shipped.is_dir() else Path(folder), SCENES[scene].scene, anyway=True)
            sensors.setdefault(scene, []).append(folder)
        return sweep(self.scenes, sensors)


def measure_all(
    configurations: Sequence[Configuration], episodes: int, seed: int, folder: Path, jobs: int = 1
) -> list[Measured]:
    """Play the searches of configurations; those of one sensor, press and touch cost in one comparison.

    ``episodes`` are searches per target of ``gel``; other scenes have fewer, see :data:`SHARES`. Finished searches in
    the folder are read.
    """
    from experiments.search.comparison import played, prepared
    from experiments.search.play import Setting
    from experiments.search.summary import ALL

    groups: dict[tuple[str, str, float, str | None], list[Configuration]] = {}
    for one in configurations:
        groups.setdefault((one.scene, one.sensor, one.touch_cost, one.fidelity), []).append(one)
    found: dict[Configuration, Measured] = {}
    for (scene, sensor, touch_cost, fidelity), group in groups.items():
        choice, own = SceneChoice(scene, fidelity), Path(sensor) if sensor else None
        setting = Setting(choice, sensor=own, touch_cost=touch_cost, anyway=True)
        number, deciders = max(1, round(episodes * SHARES[scene])), [one.decider for one in group]
        out = folder / in_file_name(f"{scene} {sensor} {touch_cost:g} {fidelity} {seed}")
        run = prepared(setting, deciders, episodes=number, seed=seed, out=out, jobs=jobs)
        comparison = played(run, None, jobs)
        for one in group:
            cell = comparison.cells[one.decider, ALL]
            right = tuple(bool(episode.success) for episode in comparison.of(one.decider))
            found[one] = Measured(one, right, cell.touches, cell.reward, **cell.seconds.ms_per_touch())
    return [found[one] for one in configurations]
