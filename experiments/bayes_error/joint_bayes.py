"""Estimator for several touches of one object: Bayes' rule over shape, orientation and size with simulated likelihoods.

It is the yardstick for readers of several touches. The independent reader, which multiplies the evidence of single
touches, forgets that all touches are of one body; it uses the same bank and the same touches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.data.manifest import read_manifest
from activetouch.scene import Scene
from activetouch.scene_description import scene_fields
from belief.statistics import cluster_bootstrap
from experiments.bayes_error.body_bank import BODIES_PER_SLICE, BodyBank
from experiments.bayes_error.estimator import Findings, paired_difference, share, words
from experiments.bayes_error.evidence_files import kept
from experiments.bayes_error.image_bank import log_posterior
from experiments.bayes_error.joint_evidence import Evidence
from experiments.bayes_error.simulation import log_loss
from experiments.bayes_error.touched_objects import TouchedObjects, press_objects, recorded_objects
from experiments.command_line.arguments import Count
from experiments.parallel import run_tasks
from experiments.reporting.tables import Table
from experiments.sensor_choice import require_scene_of

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class JointStudy:
    """What to measure.

    Attributes:
        scene: the world.
        touches: numbers of touches of one object, ascending.
        seed: of all randomness.
        jobs: processes; the results do not depend on it.
        folder: for evidence of finished slices of the bank; a run that was interrupted goes on from there.
        readers: log evidence of other readers for the same touches, from the touched objects.
    """

    scene: Scene
    touches: tuple[int, ...]
    seed: int
    jobs: int
    folder: Path
    readers: Mapping[str, Any]


@dataclass(frozen=True)
class JointBayes:
    """Bayes' rule over bodies, with a bank of simulated bodies of every shape."""

    bodies: Count = 8192
    """Bodies per shape, in steps of 128, each with an orientation and a size."""
    draws: Count = 8
    """Offsets of each body in each pose, with four forces at every one."""
    objects: Count = 500
    """Unseen objects per shape to press."""
    data: Path | None = None
    """Collection whose test objects are used instead, in their first round of poses."""

    def measure(self, study: JointStudy) -> Findings:
        """Evaluate the joint, the independent and all other readers on the same objects."""
        scene = study.scene
        bank = BodyBank.of(scene, self.draws, study.seed)
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
            "bodies": len(slices) * BODIES_PER_SLICE,
            "offsets_per_body_and_pose": self.draws,
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
                        *(log_loss(logs[:, n], touched.shapes) for logs in (other, posteriors["joint"])), study.seed
                    )
                    for n in range(len(last))
                ]
                for name, other in posteriors.items()
                if name != "joint"
            },
            "curve": [
                {"bodies": size * BODIES_PER_SLICE, **_brief(logs, touched.shapes)}
                for size, logs in zip(sizes, curve, strict=True)
            ],
        }
        return Findings("Several touches of one object", _say(numbers), _tables(study.touches, numbers), numbers)

    def _touched(self, study: JointStudy) -> TouchedObjects:
        if self.data is None:
            return press_objects(study.scene, self.objects, study.seed, study.jobs)
        require_scene_of(self.data, read_manifest(self.data), {"this scene": scene_fields(study.scene)}, False, "")
        return recorded_objects(self.data, study.seed)

    def _slices(self, study: JointStudy, bank: BodyBank, touched: TouchedObjects) -> list[Evidence]:
        """Evidence from each slice of the bank."""
        num_shapes, num_slices = len(study.scene.shapes), max(1, self.bodies // BODIES_PER_SLICE)
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


def quality(log_probs: Floats, shapes: NDArray[np.int64], touches: int, seed: int) -> dict[str, Any]:
    """Accuracy, NLL and calibration of a reader, with 95 % intervals over objects.

    Args:
        log_probs: log posteriors of objects, ``(M, K)``.
        shapes: true shapes, ``(M,)``.
        touches: of each object; only noted.
        seed: of the bootstrap.
    """
    right, stated = log_probs.argmax(axis=1) == shapes, np.exp(log_probs.max(axis=1))
    loss, *interval = cluster_bootstrap(
        log_loss(log_probs, shapes), np.arange(len(shapes)), np.random.default_rng(seed)
    )
    return {
        "touches": touches,
        "accuracy": share(right),
        "nll": {"value": loss, "interval": interval},
        "stated": float(stated.mean()),
        "stated_minus_accuracy": paired_difference(stated, right, seed),
    }


def _brief(log_probs: Floats, shapes: NDArray[np.int64]) -> dict[str, list[float]]:
    by_touches = np.moveaxis(log_probs, 1, 0)
    return {
        "accuracy": [float(np.mean(logs.argmax(axis=1) == shapes)) for logs in by_touches],
        "nll": [float(log_loss(logs, shapes).mean()) for logs in by_touches],
    }


def _say(numbers: dict[str, Any]) -> list[str]:
    joint, independent = (numbers["readers"][name][-1] for name in ("joint", "independent"))
    return [
        "Given shape, orientation and size, touches of an object are independent. The joint reader applies Bayes' rule "
        f"over {numbers['bodies']} simulated bodies of every shape, with {numbers['draws']} offsets and four forces at "
        "each for every touch; the independent reader multiplies the evidence of single touches of the same bank.",
        f"{numbers['objects']} unseen objects, each touched once in every pose, in random order. After "
        f"{joint['touches']} touches the joint reader has accuracy {words(joint['accuracy'])} and NLL "
        f"{words(joint['nll'])}, the independent reader {words(independent['accuracy'])} and "
        f"{words(independent['nll'])}.",
        "A finite bank makes the joint reader worse and too confident; the table by size of the bank shows whether it "
        "is large enough, stated minus accuracy whether the joint reader is calibrated.",
    ]


def _tables(touches: tuple[int, ...], numbers: dict[str, Any]) -> list[Table]:
    """One table for each measure, with a row for each number of touches and a column for each reader."""
    measures = {
        "accuracy": ("Accuracy", ""),
        "nll": ("NLL [nats]", ""),
        "stated_minus_accuracy": ("Stated confidence minus accuracy", "+"),
    }
    tables = [
        _table(
            title,
            touches,
            {name: [words(row[measure], sign) for row in rows] for name, rows in numbers["readers"].items()},
        )
        for measure, (title, sign) in measures.items()
    ]
    gaps = {name: [words(entry, "+") for entry in rows] for name, rows in numbers["differences"].items()}
    curve = [
        (str(row["bodies"]), *(f"{a:.4f}, {n:.4f}" for a, n in zip(row["accuracy"], row["nll"], strict=True)))
        for row in numbers["curve"]
    ]
    headings = ("bodies", *(f"{n} touches" if n > 1 else "1 touch" for n in touches))
    tables.append(_table("NLL minus that of the joint reader, same objects", touches, gaps))
    return [*tables, Table("Accuracy and NLL of the joint reader, by bodies per shape", headings, curve)]


def _table(title: str, touches: tuple[int, ...], columns: Mapping[str, list[str]]) -> Table:
    rows = [(str(n), *cells) for n, cells in zip(touches, zip(*columns.values(), strict=True), strict=True)]
    return Table(title, ("touches", *columns), rows)
