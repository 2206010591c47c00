"""The Bayes-optimal accuracy of touches of one object, and the sensor beside it.

python -m benchmarks.limit --scene coarse
python -m benchmarks.limit --scene hard --touches-per-object 1 3 --data data/hard-repeats

Few taxels: Bayes' rule over simulated bodies (:mod:`benchmarks.bayes_error.simulated`). Fine images: a lower bound on
the loss of any reader, from contacts that look the same on several shapes (:mod:`benchmarks.bayes_error.congruent`).
The estimates for the images of the scene ``paper`` are in benchmarks/force_patch_limit.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from activetouch.scene import Scene
from belief.claims import claim_folder, ends_claims
from benchmarks.bayes_error.congruent_bound import CongruentBound
from benchmarks.bayes_error.simulated import JointBayes
from experiments.command_line.arguments import BadArgument, Count, Jobs, NotEmpty, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.scene_choice import SceneChoice, in_file_names, repeats_folder
from experiments.sensor_choice import open_collection, open_sensor, require_collection

FEW_TAXELS = 64
"""Largest number of taxels for which a bank of ideal images is dense enough."""


@dataclass(frozen=True)
class Limit:
    """Estimate the best possible accuracy of touches of one object, and compare the sensor with it."""

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=lambda: SceneChoice("coarse"))
    """The world."""
    sensor: Path | None = None
    """Folder of the reader and its observation model; the scene's shipped sensor by default."""
    touches_per_object: Annotated[tuple[Count, ...], NotEmpty()] = (1, 2, 3, 4, 6)
    """Numbers of touches of one object."""
    data: Path | None = None
    """Collection with repeats, whose test objects are used; data/SCENE-repeats by default."""
    joint: Annotated[JointBayes, tyro.conf.arg(name="")] = field(default_factory=JointBayes)
    """Settings for images of few taxels."""
    congruent: CongruentBound = field(default_factory=CongruentBound)
    """Settings for fine images."""
    seed: Seed = 0
    """Seed of touches, banks and intervals."""
    out: Path | None = None
    """Folder for limit.json and limit.md; runs/limit-SCENE by default."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""

    @ends_claims
    def run(self) -> None:
        """Measure, print and write."""
        check_arguments(self)
        scene = self.choice.named.scene
        touches = tuple(sorted(set(self.touches_per_object)))
        if touches[-1] > len(scene.poses):
            raise BadArgument(
                f"--touches-per-object must be at most {len(scene.poses)}, one in each pose, got {touches[-1]}"
            )
        folder = self.out if self.out is not None else Path(f"runs/limit-{in_file_names(self.choice.scene)}")
        claim_folder(folder)
        sensor = open_sensor(self.sensor, self.choice)
        data = self.data if self.data is not None else repeats_folder(self.choice.scene)
        manifest = open_collection(data, self.choice.scene, repeats=True)
        require_collection(data, manifest, sensor.reader.card, None)
        estimator = self.joint if has_few_taxels(scene) else self.congruent
        findings = estimator.measure(sensor, data, touches, self.seed, self.jobs)
        console = plain_console()
        for sentence in findings.sentences:
            console.print(sentence)
        for table in findings.tables:
            print(table, end="\n\n")
        findings.write(folder, {"scene": self.choice.scene, "seed": self.seed})
        print(f"wrote {folder}")


def has_few_taxels(scene: Scene) -> bool:
    """Whether the images of a scene are so coarse that banks of simulated images are dense enough."""
    height, width, *channels = scene.image_shape
    return not channels and height * width <= FEW_TAXELS


if __name__ == "__main__":
    tyro.cli(Limit, config=(tyro.conf.OmitSubcommandPrefixes,)).run()
