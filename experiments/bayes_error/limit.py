"""``activetouch limit``: how well could any reader of a single touch do, and how near is the classifier?

Which estimator answers depends on what the scene's images are. Few taxels: the best reader itself, by simulated Bayes.
Force patches: readers of the few numbers an image is drawn from; or, given a collection, of every pixel. Fine images:
twins, which prove touches ambiguous one by one; or, given a collection, bounds from what the network sees.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from activetouch.rendering import ForcePatchRenderer, PressureRenderer
from activetouch.scene import Scene
from belief.files import require_writable
from experiments.bayes_error.ambiguity import TwinSearch
from experiments.bayes_error.estimator import Estimator, Study
from experiments.bayes_error.learned import LearnedView
from experiments.bayes_error.nearest_neighbour import FewNumbers
from experiments.bayes_error.pixels import CloseUp
from experiments.bayes_error.simulation import SimulatedBayes
from experiments.command_line.arguments import BadArgument, Count, Jobs, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import open_sensor

FEW_TAXELS = 64
"""Of an image, at most, for a bank of ideal images to hold one like each."""


@dataclass(frozen=True)
class Limit:
    """Estimate how well any reader of a single touch could do, and compare the classifier with it.

    For example:

        activetouch limit --scene coarse
        activetouch limit --scene hard --twins.pairs 200 --sensor runs/sensor-hard
        activetouch limit --scene hard --learned-from data/hard --out runs/limit-hard-learned
        activetouch limit --scene paper --learned-from data/paper --out runs/limit-paper-pixels
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=lambda: SceneChoice("coarse"))
    """The world."""
    sensor: Path | None = None
    """Folder of the classifier and its calibration; the shipped one of the scene by default."""
    touches: Count = 6_000
    """Fresh touches to measure on, each of another object."""
    bayes: SimulatedBayes = field(default_factory=SimulatedBayes)
    """For images of few taxels."""
    numbers: FewNumbers = field(default_factory=FewNumbers)
    """For force-patch images."""
    twins: TwinSearch = field(default_factory=TwinSearch)
    """For fine images."""
    learned_from: Path | None = None
    """For fine images instead of twins, for force-patch images instead of numbers: the collection the classifier was
    trained on."""
    seed: Seed = 0
    """Of touches, banks and intervals."""
    out: Path | None = None
    """Folder for limit.json, limit.md and figures; runs/limit-SCENE by default."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Processes; the results do not depend on it."""
    anyway: bool = False
    """Use the sensor in a scene that it was not made for."""

    def run(self) -> None:
        """Measure, print and write."""
        check_arguments(self)
        scene = self.choice.named.scene
        if self.touches < len(scene.shapes):
            raise BadArgument(f"--touches must be at least {len(scene.shapes)}, one a shape, got {self.touches}")
        folder = self.out if self.out is not None else Path(f"runs/limit-{self.choice.scene}")
        require_writable(folder)
        sensor = open_sensor(self.sensor, self.choice, self.anyway)
        findings = self.estimator(scene).measure(Study(sensor, self.touches, self.seed, self.jobs, folder))
        console = plain_console()
        for sentence in findings.sentences:
            console.print(sentence)
        for grid in findings.grids:
            console.print(grid.rich())
        findings.write(folder, {"scene": self.choice.scene, "seed": self.seed, "num_touches": self.touches})
        print(f"wrote {folder}")

    def estimator(self, scene: Scene) -> Estimator:
        """The one that suits the scene's images."""
        match scene.renderer:
            case ForcePatchRenderer():
                return self.numbers if self.learned_from is None else CloseUp(self.learned_from)
            case PressureRenderer(binning=binning) if (scene.pad.num_taxels // binning) ** 2 <= FEW_TAXELS:
                return self.bayes
            case _:
                return self.twins if self.learned_from is None else LearnedView(self.learned_from)
