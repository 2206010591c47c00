"""``activetouch tradeoff``: speed against accuracy of networks, observation models, presses and deciders."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

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
from experiments.command_line.console import plain_console
from experiments.parallel import run_tasks
from experiments.scene_choice import repeats_folder
from experiments.tradeoff.configuration import SHARES, VARIED

if TYPE_CHECKING:
    from experiments.tradeoff.measure import SearchResult, TouchCost


@dataclass(frozen=True)
class Tradeoff:
    """Measure the trade-off between speed and accuracy, draw the Pareto front and recommend configurations.

    A scene's default is its sensor of one rigid body with information gain. Every other configuration differs in one
    thing: the decider, the touch cost, the shipped sensor, the network, the number of hypotheses or the fidelity. All
    configurations of a scene play the same live searches.
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
    finished: bool = False
    """Do not run searches; report on all results found in the folder."""
    jobs: Jobs = 1
    """Number of processes; the results do not depend on it."""

    @ends_claims
    def run(self) -> None:
        """Measure what is missing, then write and print the report.

        Raises:
            BadArgument: There are no results, or a reader is not given as SCENE=FILE.
            UnknownName: There is no such scene.
        """
        from experiments.tradeoff.measure import finished, num_outdated
        from experiments.tradeoff.picks import Candidate, fronts, picks
        from experiments.tradeoff.report import sentences, short_front_table, write_tradeoff_report

        check_arguments(self)
        for scene in self.scenes:
            if scene not in SHARES:
                raise UnknownName("scene of the trade-off", scene, list(SHARES))
        claim_folder(self.out)
        results = finished(self.out, self.seed) if self.finished else self.measure()
        if not results:
            raise BadArgument(f"{self.out} holds no results yet; leave out --finished to measure some")
        found = fronts([Candidate(*result) for result in results], np.random.default_rng(self.seed))
        answers = {front.task: picks(front, self.success, self.milliseconds) for front in found}
        write_tradeoff_report(self.out, found, answers, {**asdict(self), "out": str(self.out)})
        console = plain_console()
        for front in found:
            console.print(short_front_table(front).rich())
        for line in sentences(answers, self.out):
            console.print(line, soft_wrap=True)
        if outdated := num_outdated(result for result, _ in results):
            console.print(
                f"{outdated} of {len(results)} results are kept from other code or other versions of packages. Delete "
                f"{self.out / 'results'} to measure all again.",
                soft_wrap=True,
            )
        print(f"wrote {self.out}/report.html, tradeoff.md, .json, .csv, .svg and .png")

    def measure(self) -> list[tuple[SearchResult, TouchCost]]:
        """Measure all configurations; return their results and costs."""
        from experiments.tradeoff.configuration import Network, shipped_networks, sweep
        from experiments.tradeoff.measure import measured, touch_cost

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
        configurations = sweep(networks, calibrated, self.episodes, self.seed)
        if self.vary:
            configurations = [c for c in configurations if c.varied in ("nothing", *self.vary)]
        timings = [partial(touch_cost, c, self.out) for c in configurations]
        searches = [partial(measured, c, self.out) for c in configurations]
        # Timed one by one, before the searches, whose processes would disturb the times.
        costs = dict(zip(configurations, run_tasks(timings, 1, "timing touches"), strict=True))
        return [(found, costs[found.configuration]) for found in run_tasks(searches, self.jobs, "searching")]
