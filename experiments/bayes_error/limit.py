"""``activetouch limit``: estimate the Bayes-optimal accuracy of touches and compare the classifier with it.

The estimator depends on the images. Few taxels: Bayes' rule with simulated likelihoods. Fine images: a search for
presses of another shape with the same image up to noise, or, given a collection, bounds from the network's outputs.

With ``--touches-per-object``, the limit of several touches of one object. Few taxels: Bayes' rule over simulated bodies
(:mod:`experiments.bayes_error.joint_bayes`). Fine images: a lower bound on the loss of any reader, from contacts that
look the same on several shapes (:mod:`experiments.bayes_error.congruent_bound`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from activetouch.scene import Scene
from belief.claims import claim_folder, ends_claims
from experiments.bayes_error.ambiguity import AmbiguitySearch
from experiments.bayes_error.congruent_bound import CongruentBound
from experiments.bayes_error.estimator import Estimator, Findings, LimitStudy
from experiments.bayes_error.joint_bayes import JointBayes, JointStudy
from experiments.bayes_error.learned import LearnedBounds
from experiments.bayes_error.sensor_evidence import sensor_evidence
from experiments.bayes_error.simulation import SimulatedBayes
from experiments.command_line.arguments import BadArgument, Count, Jobs, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.scene_choice import SceneChoice, in_file_names, repeats_folder
from experiments.sensor_choice import open_collection, open_sensor, require_collection

FEW_TAXELS = 64
"""Largest number of taxels for which a bank of ideal images is dense enough."""


@dataclass(frozen=True)
class Limit:
    """Estimate the best possible accuracy of one touch, and compare the classifier with it.

    The estimates for the images of the scene "paper" are in benchmarks/force_patch_limit.py.

    For example:

        activetouch limit --scene coarse
        activetouch limit --scene coarse --touches-per-object 1 2 3 4 6 --sensor coarse
        activetouch limit --scene hard --touches-per-object 1 2 3 4 6
        activetouch limit --scene hard --ambiguity.pairs 200 --sensor runs/sensor-hard
        activetouch limit --scene hard --learned-from data/hard --out runs/limit-hard-learned
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=lambda: SceneChoice("coarse"))
    """The world."""
    sensor: Path | None = None
    """Folder of the classifier and its observation model; the scene's shipped sensor by default."""
    touches: Count = 6_000
    """Number of held-out touches to measure on, each of another object."""
    bayes: SimulatedBayes = field(default_factory=SimulatedBayes)
    """Settings for images of few taxels."""
    ambiguity: AmbiguitySearch = field(default_factory=AmbiguitySearch)
    """Settings for fine images."""
    learned_from: Path | None = None
    """Collection that the classifier was trained on: compute bounds from the network's outputs instead."""
    touches_per_object: tuple[Count, ...] = ()
    """Numbers of touches of one object: estimate the best possible accuracy of several touches instead."""
    joint: Annotated[JointBayes, tyro.conf.arg(name="")] = field(default_factory=JointBayes)
    """Settings for several touches and images of few taxels; --data also serves fine images, data/SCENE-repeats by
    default."""
    congruent: CongruentBound = field(default_factory=CongruentBound)
    """Settings for several touches and fine images."""
    seed: Seed = 0
    """Seed of touches, banks and intervals."""
    out: Path | None = None
    """Folder for limit.json, limit.md and figures; runs/limit-SCENE by default, runs/limit-SCENE-joint for several
    touches."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the results do not depend on it."""
    anyway: bool = False
    """Use the sensor in a scene that it was not made for."""

    @ends_claims
    def run(self) -> None:
        """Measure, print and write."""
        check_arguments(self)
        scene = self.choice.named.scene
        if self.touches < len(scene.shapes):
            raise BadArgument(f"--touches must be at least {len(scene.shapes)}, one for each shape, got {self.touches}")
        most = max(self.touches_per_object, default=0)
        if most > len(scene.poses):
            raise BadArgument(f"--touches-per-object must be at most {len(scene.poses)}, one in each pose, got {most}")
        if not most and (self.joint, self.congruent) != (JointBayes(), CongruentBound()):
            raise BadArgument(
                "--bodies, --draws, --objects, --data and --congruent.orders are for several touches: add "
                "--touches-per-object"
            )
        name = f"runs/limit-{in_file_names(self.choice.scene)}{'-joint' if most else ''}"
        folder = self.out if self.out is not None else Path(name)
        claim_folder(folder)
        findings = self._several(scene, folder) if most else self._single(scene, folder)
        console = plain_console()
        for sentence in findings.sentences:
            console.print(sentence)
        for table in findings.tables:
            console.print(table.rich())
        identity = {"scene": self.choice.scene, "seed": self.seed}
        findings.write(folder, identity if most else {**identity, "num_touches": self.touches})
        print(f"wrote {folder}")

    def _single(self, scene: Scene, folder: Path) -> Findings:
        sensor = open_sensor(self.sensor, self.choice, self.anyway)
        return self.estimator(scene).measure(LimitStudy(sensor, self.touches, self.seed, self.jobs, folder))

    def _several(self, scene: Scene, folder: Path) -> Findings:
        touches = tuple(sorted(set(self.touches_per_object)))
        sensor = open_sensor(self.sensor, self.choice, self.anyway)
        if not has_few_taxels(scene):
            data = self.joint.data if self.joint.data is not None else repeats_folder(self.choice.scene)
            require_collection(
                data, open_collection(data, self.choice.scene, repeats=True), sensor.reader.card, None, repeats=True
            )
            return self.congruent.measure(sensor, data, touches, self.seed, self.jobs)
        readers = {"sensor": partial(sensor_evidence, sensor)}
        return self.joint.measure(JointStudy(scene, touches, self.seed, self.jobs, folder / "evidence", readers))

    def estimator(self, scene: Scene) -> Estimator:
        """The estimator for the images of a scene."""
        if self.learned_from is not None:
            return LearnedBounds(self.learned_from)
        return self.bayes if has_few_taxels(scene) else self.ambiguity


def has_few_taxels(scene: Scene) -> bool:
    """Whether the images of a scene are so coarse that banks of simulated images are dense enough."""
    height, width, *channels = scene.image_shape
    return not channels and height * width <= FEW_TAXELS
