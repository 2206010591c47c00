"""Estimator for images of few taxels: Bayes' rule over shape, orientation and size with simulated likelihoods.

It is the yardstick for readers of one touch or of several of one object. The independent reader, which multiplies the
evidence of single touches, forgets that all touches are of one body; it uses the same bank and the same touches.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.sensor import TactileSensor
from belief.table import Table
from benchmarks.bayes_error.body_bank import BODIES_PER_SLICE, FORCES_PER_OFFSET, BodyBank
from benchmarks.bayes_error.evidence import Evidence, log_posterior
from benchmarks.bayes_error.findings import Findings, by_touches, log_loss, mean_of_objects, paired_difference, words
from benchmarks.bayes_error.touched_objects import TouchedObjects, recorded_objects, sensor_evidence
from benchmarks.several_touches import after_touches
from experiments.command_line.arguments import Count
from experiments.parallel import run_tasks

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class JointBayes:
    """Bayes' rule over bodies, with a bank of simulated bodies of every shape."""

    bodies: Count = 8192
    """Bodies per shape, each with an orientation and a size; in steps of 256, or fewer."""
    draws: Count = 8
    """Offsets of each body in each pose, with four forces at every one."""

    def measure(self, sensor: TactileSensor, data: Path, touches: tuple[int, ...], seed: int, jobs: int) -> Findings:
        """Evaluate the joint reader, the independent one and the sensor on the same objects.

        Args:
            sensor: to compare, in its scene.
            data: collection of touches in every pose, whose test objects are used.
            touches: numbers of touches of one object, ascending.
            seed: of all randomness.
            jobs: processes; the results do not depend on it.

        Raises:
            UnknownLikelihood: the scene has no likelihood in closed form, or no bodies.
            CorruptFile: there is no such collection, or it is damaged.
        """
        scene = sensor.scene
        bank = BodyBank.of(scene, self.draws, seed, min(self.bodies, BODIES_PER_SLICE))
        touched = recorded_objects(data, seed)
        slices, truth = self._slices(bank, touched, jobs), touched.shapes
        whole, last = Evidence.pooled(slices), [n - 1 for n in touches]
        found = {
            "joint": whole.joint,
            "independent": whole.independent(touched.orders),
            "sensor": sensor_evidence(sensor, touched, touched.orders),
        }
        after = {name: np.moveaxis(log_posterior(logs[:, last]), 1, 0) for name, logs in found.items()}  # (T, M, K)
        loss = {name: [log_loss(each, truth) for each in logs] for name, logs in after.items()}
        sizes = dict.fromkeys(size for part in (8, 4, 2, 1) if (size := len(slices) // part))
        numbers: dict[str, Any] = {
            "estimator": "simulated Bayes over bodies",
            "objects": len(truth),
            "bodies": len(slices) * bank.slice_size,
            "images_per_body_and_pose": self.draws * FORCES_PER_OFFSET,
            "force_ratios": dict(zip(scene.shape_labels, bank.force_ratios, strict=True)),
            "readers": {
                name: [_quality(each, truth, n, seed) for n, each in zip(touches, logs, strict=True)]
                for name, logs in after.items()
            },
            "differences": {
                name: [
                    paired_difference(one, other, seed) for one, other in zip(loss[name], loss["joint"], strict=True)
                ]
                for name in ("independent", "sensor")
            },
            "single_touches": _single_touches(sensor, touched, whole, seed),
            "curve": [
                {"bodies": size * bank.slice_size, **_brief(Evidence.pooled(slices[:size]).joint[:, last], truth)}
                for size in sizes
            ],
        }
        return Findings("Several touches of one object", _sentences(numbers), _tables(touches, numbers), numbers)

    def _slices(self, bank: BodyBank, touched: TouchedObjects, jobs: int) -> list[Evidence]:
        """Evidence from each slice of the bank."""
        shapes, numbers = range(len(bank.scene.shapes)), range(self.bodies // bank.slice_size)
        tasks = [partial(bank.evidence, touched, shape, number) for number in numbers for shape in shapes]
        found = {(number, shape): part for shape, number, part in run_tasks(tasks, jobs, "bank of simulated bodies")}
        return [Evidence.of_shapes([found[number, shape] for shape in shapes]) for number in numbers]


def _quality(log_probs: Floats, shapes: NDArray[np.int64], touches: int, seed: int) -> dict[str, Any]:
    """Accuracy, NLL and calibration of log posteriors ``(M, K)``, with 95 % intervals over objects."""
    found = after_touches(log_probs, shapes, np.arange(len(shapes)), touches, seed)
    return {
        "touches": touches,
        "accuracy": {"value": found.accuracy, "interval": found.accuracy_interval},
        "nll": {"value": found.nll, "interval": found.nll_interval},
        "stated": found.stated,
        "stated_minus_accuracy": {"value": found.gap, "interval": found.gap_interval},
    }


def _single_touches(sensor: TactileSensor, touched: TouchedObjects, bank: Evidence, seed: int) -> dict[str, Any]:
    """Accuracy, stated confidence and NLL of all touches alone, with 95 % intervals that resample objects."""
    objects, poses = touched.orders.shape
    alone = [sensor_evidence(sensor, touched, np.full((objects, 1), pose)) for pose in range(poses)]
    shapes, of_object = np.repeat(touched.shapes, poses), np.repeat(np.arange(objects), poses)
    found = {}
    for name, evidence in (("joint", bank.single), ("sensor", np.concatenate(alone, axis=1))):
        logs = log_posterior(evidence).reshape(objects * poses, -1)
        measures = {
            "accuracy": logs.argmax(axis=1) == shapes,
            "stated": np.exp(logs.max(axis=1)),
            "nll": log_loss(logs, shapes),
        }
        found[name] = {key: mean_of_objects(values, of_object, seed) for key, values in measures.items()}
    return found


def _brief(evidence: Floats, shapes: NDArray[np.int64]) -> dict[str, list[float]]:
    """Accuracy and NLL by number of touches, from log evidence ``(M, T, K)``."""
    after_each = np.moveaxis(log_posterior(evidence), 1, 0)
    return {
        "accuracy": [float(np.mean(logs.argmax(axis=1) == shapes)) for logs in after_each],
        "nll": [float(log_loss(logs, shapes).mean()) for logs in after_each],
    }


def _sentences(numbers: dict[str, Any]) -> list[str]:
    """Method and main results."""
    joint, independent = (numbers["readers"][name][-1] for name in ("joint", "independent"))
    number = f"{joint['touches']} touch{'es' * (joint['touches'] > 1)}"
    return [
        "Given shape, orientation and size, touches of an object are independent. The joint reader applies Bayes' rule "
        f"over {numbers['bodies']} simulated bodies of every shape, with {numbers['images_per_body_and_pose']} images "
        "of each in every pose; the independent reader multiplies the evidence of single touches of the same bank.",
        f"{numbers['objects']} unseen objects, each touched once in every pose, in random order. After {number} the "
        f"joint reader has accuracy {words(joint['accuracy'])} and NLL {words(joint['nll'])}, the independent reader "
        f"{words(independent['accuracy'])} and {words(independent['nll'])}.",
        "A finite bank makes the joint reader worse and too confident; the table by size of the bank shows whether it "
        "is large enough, stated minus accuracy whether the joint reader is calibrated. It makes the accuracy too low "
        "and the stated confidence too high, so the best possible accuracy is between the two.",
    ]


def _tables(touches: tuple[int, ...], numbers: dict[str, Any]) -> list[Table]:
    """One table for each measure, with a row for each number of touches and a column for each reader."""

    def of(measure: str, sign: str = "") -> dict[str, list[str]]:
        return {name: [words(row[measure], sign) for row in rows] for name, rows in numbers["readers"].items()}

    gaps = {name: [words(entry, "+") for entry in rows] for name, rows in numbers["differences"].items()}
    curve = {
        f"{row['bodies']}": [f"{a:.4f}, {n:.4f}" for a, n in zip(row["accuracy"], row["nll"], strict=True)]
        for row in numbers["curve"]
    }
    alone = [(name, *map(words, measured.values())) for name, measured in numbers["single_touches"].items()]
    return [
        Table("One touch, all poses of all objects", ("reader", "accuracy", "stated", "NLL"), alone),
        by_touches("Accuracy", touches, of("accuracy")),
        by_touches("NLL [nats]", touches, of("nll")),
        by_touches("Stated confidence minus accuracy", touches, of("stated_minus_accuracy", "+")),
        by_touches("NLL minus that of the joint reader, same objects", touches, gaps),
        by_touches("Accuracy and NLL of the joint reader, by bodies per shape", touches, curve),
    ]
