"""Estimator for several touches of one object: Bayes' rule over shape, orientation and size with simulated likelihoods.

It is the yardstick for readers of several touches. The independent reader, which multiplies the evidence of single
touches, forgets that all touches are of one body; it uses the same bank and the same touches.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.data.manifest import read_manifest
from activetouch.scene import Scene
from activetouch.scene_description import scene_fields
from experiments.bayes_error.body_bank import BODIES_PER_SLICE, FORCES_PER_OFFSET, BodyBank
from experiments.bayes_error.estimator import Findings, paired_difference
from experiments.bayes_error.evidence_files import kept
from experiments.bayes_error.image_bank import log_posterior
from experiments.bayes_error.joint_evidence import Evidence
from experiments.bayes_error.joint_report import brief, quality, sentences, tables
from experiments.bayes_error.simulation import log_loss
from experiments.bayes_error.touched_objects import TouchedObjects, press_objects, recorded_objects
from experiments.command_line.arguments import Count
from experiments.parallel import run_tasks
from experiments.sensor_choice import require_scene_of


@dataclass(frozen=True, eq=False)
class JointStudy:
    """What to measure.

    Attributes:
        scene: the world.
        touches: numbers of touches of one object, ascending.
        seed: of all randomness.
        jobs: processes; the results do not depend on it.
        folder: for evidence of finished slices of the bank; a run that was interrupted goes on from there.
        readers: others to compare with: from touched objects to joint log evidence ``(M, P, K)``, by name.
    """

    scene: Scene
    touches: tuple[int, ...]
    seed: int
    jobs: int
    folder: Path
    readers: Mapping[str, Callable[[TouchedObjects], NDArray[np.float64]]] = field(default_factory=dict)


@dataclass(frozen=True)
class JointBayes:
    """Bayes' rule over bodies, with a bank of simulated bodies of every shape."""

    bodies: Count = 8192
    """Bodies per shape, each with an orientation and a size; in steps of 256, or fewer."""
    draws: Count = 8
    """Offsets of each body in each pose, with four forces at every one."""
    objects: Count = 500
    """Unseen objects per shape to press."""
    data: Path | None = None
    """Collection whose test objects are used instead, in their first round of poses."""

    def measure(self, study: JointStudy) -> Findings:
        """Evaluate the joint, the independent and all other readers on the same objects."""
        scene = study.scene
        bank = BodyBank.of(scene, self.draws, study.seed, min(self.bodies, BODIES_PER_SLICE))
        touched = self._touched(study)
        slices = self._slices(study, bank, touched)
        whole, last = Evidence.pooled(slices), [n - 1 for n in study.touches]
        found = {"joint": whole.joint, "independent": whole.independent(touched.orders)}
        found |= {name: reader(touched) for name, reader in study.readers.items()}
        posteriors = {name: log_posterior(evidence[:, last]) for name, evidence in found.items()}
        sizes = dict.fromkeys(size for part in (8, 4, 2, 1) if (size := len(slices) // part))
        curve = [log_posterior(Evidence.pooled(slices[:size]).joint[:, last]) for size in sizes]
        numbers: dict[str, Any] = {
            "estimator": "simulated Bayes over bodies",
            "objects": len(touched.shapes),
            "bodies": len(slices) * bank.slice_size,
            "images_per_body_and_pose": self.draws * FORCES_PER_OFFSET,
            "force_ratios": dict(zip(scene.shape_labels, bank.force_ratios, strict=True)),
            "readers": {
                name: [
                    quality(each, touched.shapes, n, study.seed)
                    for n, each in zip(study.touches, np.moveaxis(logs, 1, 0), strict=True)
                ]
                for name, logs in posteriors.items()
            },
            "differences": {
                name: [
                    paired_difference(
                        log_loss(other[:, n], touched.shapes),
                        log_loss(posteriors["joint"][:, n], touched.shapes),
                        study.seed,
                    )
                    for n in range(len(last))
                ]
                for name, other in posteriors.items()
                if name != "joint"
            },
            "curve": [
                {"bodies": size * bank.slice_size, **brief(logs, touched.shapes)}
                for size, logs in zip(sizes, curve, strict=True)
            ],
        }
        return Findings("Several touches of one object", sentences(numbers), tables(study.touches, numbers), numbers)

    def _touched(self, study: JointStudy) -> TouchedObjects:
        if self.data is None:
            return press_objects(study.scene, self.objects, study.seed, study.jobs)
        require_scene_of(self.data, read_manifest(self.data), {"this scene": scene_fields(study.scene)}, False, "")
        return recorded_objects(self.data, study.seed)

    def _slices(self, study: JointStudy, bank: BodyBank, touched: TouchedObjects) -> list[Evidence]:
        """Evidence from each slice of the bank."""
        num_shapes, num_slices = len(study.scene.shapes), self.bodies // bank.slice_size
        tasks = [
            partial(kept, study.folder, bank, touched, shape, number)
            for number in range(num_slices)
            for shape in range(num_shapes)
        ]
        found = {
            (number, shape): part for shape, number, part in run_tasks(tasks, study.jobs, "bank of simulated bodies")
        }
        return [
            Evidence.of_shapes([found[number, shape] for shape in range(num_shapes)]) for number in range(num_slices)
        ]
