"""``activetouch tradeoff``: speed against accuracy of networks, observation models, presses and deciders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

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
from experiments.scene_choice import repeats_folder
from experiments.tradeoff.configuration import SHARES, VARIED, Configuration, Network, shipped_networks, sweep

if TYPE_CHECKING:
    from experiments.tradeoff.measure import Measured


@dataclass(frozen=True)
class Tradeoff:
    """Measure the trade-off between speed and accuracy, draw the Pareto front and recommend configurations.

    A scene's default is its sensor of one rigid body with information gain. Every other configuration differs in one
    property: the decider, the touch cost, the shipped sensor, the network, the number of hypotheses or the fidelity.
    All configurations of a scene play the same live searches.
    Observation models of other networks and numbers are fitted to recorded touches (activetouch collect
    --plan.repeats 6 --out data/SCENE-repeats); without recorded touches they are left out. Results are kept by
    configuration: after an interruption, the same command continues.

    For example:

        activetouch tradeoff
        activetouch tradeoff --scenes coarse --episodes 50
        activetouch tradeoff --readers gel=runs/train-gel-tiny-32/reader.safetensors
        activetouch tradeoff --scenes coarse --vary hypotheses
    """

    scenes: Annotated[tuple[str, ...], NotEmpty()] = tuple(SHARES)
    """Scenes to measure: gel, coarse, paper, hard or many."""
    readers: tuple[str, ...] = ()
    """Readers with other backbones or resolutions to measure as well, each as SCENE=FILE."""
    vary: tuple[Literal[VARIED], ...] = ()  # type: ignore[valid-type]
    """Properties to vary, such as hypotheses; all by default."""
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
            BadArgument: A reader is not given as SCENE=FILE.
            UnknownName: There is no such scene.
        """
        from experiments.tradeoff.report import TradeoffReport  # loads jinja2

        check_arguments(self)
        for scene in self.scenes:
            if scene not in SHARES:
                raise UnknownName("scene of the trade-off", scene, list(SHARES))
        claim_folder(self.out)
        points = measure_all(self._configurations(), self.out, self.jobs)
        found = TradeoffReport(points, self.out, self.success, self.milliseconds)
        found.save(self.out)
        for table in found.short_tables():
            print(table, end="\n\n")
        for line in found.sentences():
            print(line)
        print(f"wrote {self.out}/report.html, tradeoff.md, .json, .csv, .svg and .png")

    def _configurations(self) -> list[Configuration]:
        scenes = list(dict.fromkeys(self.scenes))
        networks = [network for scene in scenes for network in shipped_networks(scene)]
        for reader in self.readers:
            scene, _, file = reader.partition("=")
            if scene not in self.scenes or not file:
                raise BadArgument(
                    f"--readers must be SCENE=FILE with a scene of {', '.join(self.scenes)}; got {reader!r}"
                )
            networks.append(Network.in_file(scene, Path(file)))
        calibrated = [scene for scene in self.scenes if (repeats_folder(scene) / "manifest.json").exists()]
        found = sweep(networks, calibrated, self.episodes, self.seed)
        return [c for c in found if not self.vary or c.varied in ("nothing", *self.vary)]


def measure_all(configurations: Sequence[Configuration], folder: Path, jobs: int = 1) -> list[Measured]:
    """Measure configurations; results in the folder are kept and read.

    Args:
        configurations: configurations to measure, such as those of :func:`experiments.tradeoff.configuration.sweep`.
        folder: folder of the results, and of sensors that do not come with the package.
        jobs: number of processes.
    """
    from experiments.tradeoff.measure import measured  # loads MuJoCo

    tasks = [partial(measured, c, folder) for c in configurations]
    found = {result.configuration: result for result in run_tasks(tasks, jobs, "searching")}
    return [found[configuration] for configuration in configurations]
