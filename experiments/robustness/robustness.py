"""``activetouch robustness``: what a sensor still tells when the world is not the one it was trained in.

The same objects are touched in every pose under many conditions, one thing changed at a time, so that the difference to
the world as trained is paired. Last come objects of shapes that were never learned: the sensor must name one that it
knows, but do its scores say that it cannot know?
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.shapes import EXTENDED_SHAPES
from belief.files import require_writable, write_text
from belief.metrics import expected_calibration_error, negative_log_likelihood
from belief.observation_model import ArrayModel
from belief.observation_model.selection import log_posteriors
from belief.out_of_distribution import MahalanobisScore, auroc_interval, energy_score
from belief.statistics import clopper_pearson_interval, cluster_bootstrap, paired_bootstrap
from belief.touch_batch import TouchBatch
from experiments.command_line.arguments import CountOrNone, Jobs, Seed, Within, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.robustness.shifted_touches import AS_TRAINED, Felt, Series, choose, feel
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import open_sensor

_REFERENCE, _UNSEEN = "more known objects", "unseen shapes"


@dataclass(frozen=True)
class Robustness:
    """Measure a sensor under faults, other objects, other presses and unseen shapes.

    Writes ``robustness.json``, the tables ``robustness.md`` and the figure ``robustness.svg`` and ``.png``.

    For example:

        activetouch robustness --scene gel --objects 100
        activetouch robustness --scene coarse --sensor runs/sensor-coarse --deformable 5
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world that the sensor was trained in."""
    sensor: Path | None = None
    """Folder from ``activetouch calibrate``; the scene's shipped sensor by default."""
    objects: Annotated[int, Within(2, 10**8)] = 100
    """Of every shape, each touched once in every pose, in every condition; at least two."""
    deformable: CountOrNone = 0
    """How many of them to press into the soft pad too, where a press takes seconds."""
    seed: Seed = 0
    """Of the objects, their touches and the bootstrap."""
    out: Path | None = None
    """Folder for the results; runs/robustness-SCENE by default."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Processes that press; the results do not depend on it."""
    anyway: bool = False
    """Use the sensor for a scene that it was not made for, as the world it was trained in."""

    def run(self) -> None:
        """Touch, measure, print and write."""
        check_arguments(self)
        from experiments.robustness.report import draw_conditions, tables  # loads matplotlib

        scene, name = self.choice.named.scene, self.choice.scene
        out = self.out if self.out is not None else Path(f"runs/robustness-{name}")
        require_writable(out)
        sensor = open_sensor(self.sensor, self.choice, self.anyway)
        series, left_out = choose(scene, self.objects, self.deformable)
        conditions, novel = list(series), {k: v for k, v in EXTENDED_SHAPES.items() if k not in scene.shapes}
        if novel:
            series[_REFERENCE] = Series(scene, self.objects, stream=1)
            series[_UNSEEN] = Series(replace(scene, shapes=novel), self.objects)
        else:
            left_out[_UNSEEN] = "it was trained on all that there are"
        felt = feel(sensor, series, self.seed, self.jobs)
        trained = felt[AS_TRAINED]
        numbers = {
            "scene": name,
            "seed": self.seed,
            "objects_per_shape": self.objects,
            "num_poses": len(scene.poses),
            "chance": 1.0 / len(scene.shapes),
            "conditions": {c: measure(felt[c], trained, sensor.model, self.seed) for c in conditions},
            "unseen": tell_apart(felt[_REFERENCE], trained, felt[_UNSEEN], sensor.model, tuple(novel)) if novel else {},
            "left_out": left_out,
            "shift": list(sensor.shift),
        }
        found = tables(numbers)
        for table in found:
            plain_console().print(table.rich())
        write_text(out / "robustness.json", json.dumps(numbers, indent=1) + "\n")
        write_text(out / "robustness.md", "\n\n".join(table.markdown() for table in found) + "\n")
        draw_conditions(numbers, out / "robustness.svg", out / "robustness.png")
        print(f"wrote {out}")


def measure(felt: Felt, trained: Felt, model: ArrayModel, seed: int) -> dict[str, Any]:
    """How well the sensor does in a condition, and how that differs from the world as trained; intervals at 95 %.

    Returns:
        ``num_objects`` touched; ``accuracy`` of single touches and its ``difference`` to the world as trained, paired
        by object, both with bootstrap intervals over objects; ``is_chance``: no better than guessing, as far as the
        interval tells; ``nll`` and ``ece`` of single touches by the sensor's own observation model; ``fused_accuracy``
        of all touches of an object together, with its exact binomial interval.
    """
    (num_objects, num_poses, num_shapes), rng = felt.logits.shape, np.random.default_rng(seed)
    right, right_trained = ((f.logits.argmax(axis=2) == f.shapes[:, None]).mean(axis=1) for f in (felt, trained))
    accuracy, *interval = cluster_bootstrap(right, felt.numbers, rng)
    _, here, there = np.intersect1d(felt.numbers, trained.numbers, return_indices=True)
    difference, *difference_interval = paired_bootstrap(right[here], right_trained[there], rng)
    probs, labels = _read_alone(felt, model).reshape(-1, num_shapes), felt.shapes.repeat(num_poses)
    touches = TouchBatch(np.tile(np.arange(num_poses), (num_objects, 1)), felt.logits)
    num_found = int((log_posteriors(model, touches).argmax(axis=1) == felt.shapes).sum())
    return {
        "num_objects": num_objects,
        "accuracy": accuracy,
        "accuracy_interval": interval,
        "difference": difference,
        "difference_interval": difference_interval,
        "is_chance": interval[0] <= 1.0 / num_shapes,
        "nll": negative_log_likelihood(probs, labels),
        "ece": expected_calibration_error(probs, labels),
        "fused_accuracy": num_found / num_objects,
        "fused_interval": clopper_pearson_interval(num_found, num_objects),
    }


def tell_apart(
    fit: Felt, known: Felt, novel: Felt, model: ArrayModel, novel_labels: tuple[str, ...]
) -> dict[str, dict[str, Any]]:
    """Whether shapes that were never learned are told from those that were, by shape and for all of them together.

    Args:
        fit: touches of known shapes that the Mahalanobis score is fitted to.
        known: of other objects of known shapes.
        novel: of objects of unseen shapes.
        model: says how sure the sensor is of one touch.
        novel_labels: names of the unseen shapes.

    Returns:
        Per shape ``num_objects``; ``auroc`` by score and by what is scored, a touch or the mean over an object's
        touches, each with its 95 % interval; ``taken_for``, the known shape that most touches are taken for, and their
        ``share``; ``confidence``, the mean of the calibrated probability of the shape a touch is taken for.
    """
    mahalanobis = MahalanobisScore.fit(np.concatenate(fit.features), fit.shapes.repeat(fit.features.shape[1]))
    scores = {
        "energy": [energy_score(felt.logits) for felt in (known, novel)],
        "mahalanobis": [
            mahalanobis.score(np.concatenate(felt.features)).reshape(felt.features.shape[:2]) for felt in (known, novel)
        ],
    }
    taken, confidence = novel.logits.argmax(axis=2), _read_alone(novel, model).max(axis=2)
    every = {label: novel.shapes == k for k, label in enumerate(novel_labels)} | {"all": novel.shapes >= 0}
    told = {}
    for label, rows in every.items():
        counts = np.bincount(taken[rows].ravel(), minlength=len(model.shape_labels))
        told[label] = {
            "num_objects": int(rows.sum()),
            "auroc": {
                name: {
                    "touch": auroc_interval(old, new[rows]),
                    "object": auroc_interval(old.mean(axis=1), new[rows].mean(axis=1)),
                }
                for name, (old, new) in scores.items()
            },
            "taken_for": model.shape_labels[int(counts.argmax())],
            "share": float(counts.max() / counts.sum()),
            "confidence": float(confidence[rows].mean()),
        }
    return told


def _read_alone(felt: Felt, model: ArrayModel) -> NDArray[np.float64]:
    """Posterior of every touch by itself, all shapes equally likely beforehand, ``(N, P, K)``."""
    num_objects, num_poses, num_shapes = felt.logits.shape
    poses = np.tile(np.arange(num_poses), num_objects)
    alone = TouchBatch(poses[:, None], felt.logits.reshape(-1, 1, num_shapes))
    return np.exp(log_posteriors(model, alone)).reshape(felt.logits.shape)
