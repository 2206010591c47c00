"""``activetouch calibrate``: fit the observation model on the calibration split and measure it on the test split."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from activetouch.atomic import write_text
from activetouch.dataset import TouchSet, read_manifest, read_split
from activetouch.world import CLASSIFIER_FILE, OBSERVATION_FILE
from belief import Touch
from belief.calibration import TemperatureScaling
from belief.metrics import confusion_matrix, expected_calibration_error, negative_log_likelihood, shape_scores
from belief.observation_model import ConfusionModel
from belief.selection import cross_validated_nll, group_by_object, log_posteriors
from belief.statistics import clopper_pearson_interval, cluster_bootstrap
from experiments.baseline import depth_and_force_accuracy
from experiments.scene_choice import collection_folder, named_scene, training_folder
from experiments.scores import read_logits

if TYPE_CHECKING:
    from activetouch.classifier import TouchClassifier

CANDIDATE_EDGES: tuple[tuple[float, ...], ...] = ((), (0.9,), (0.7, 0.95), (0.6, 0.9, 0.99))
"""Confidence bins to choose from; the empty one is the plain confusion matrix."""


@dataclass(frozen=True)
class Calibrate:
    """Fit temperature and observation model on objects the classifier never saw; report on yet others.

    Writes the classifier, the observation model and ``evaluation.json`` into one folder that the other commands use.

    For example:

        activetouch calibrate --scene gel
        activetouch calibrate --data data/mug --classifier runs/train-mug/classifier.safetensors --out runs/sensor-mug
    """

    scene: str = "gel"
    """The scene it is for: decides the next three where they are not given."""
    classifier: Path | None = None
    """Checkpoint from ``activetouch train``; runs/train-SCENE/classifier.safetensors by default."""
    data: Path | None = None
    """Folder of the collection; data/SCENE by default."""
    out: Path | None = None
    """Folder of the finished sensor; runs/sensor-SCENE by default."""
    seed: int = 0
    """Of the bootstrap intervals."""

    def run(self) -> None:
        """Fit, write, and print the evaluation."""
        from activetouch.classifier import TouchClassifier  # loads torch

        named_scene(self.scene)  # or say which there are
        data = self.data if self.data is not None else collection_folder(self.scene)
        out = self.out if self.out is not None else Path(f"runs/sensor-{self.scene}")
        trained = self.classifier if self.classifier is not None else training_folder(self.scene) / CLASSIFIER_FILE
        classifier = TouchClassifier.load(trained)
        labels, num_poses = classifier.card.shape_labels, len(classifier.card.pose_labels)
        manifest = read_manifest(data)
        classifier.require_labels(manifest.shape_labels, manifest.pose_labels)
        calibration = read_split(data, "calibration")
        touches = _read(classifier, calibration, "reading calibration touches")
        fit = partial(ConfusionModel.fit, shape_labels=labels, num_poses=num_poses)
        losses = {
            edges: cross_validated_nll(
                partial(fit, confidence_edges=edges), touches, calibration.shapes, calibration.object_ids
            )
            for edges in CANDIDATE_EDGES
        }
        edges = min(losses, key=losses.__getitem__)
        model = fit(touches, calibration.shapes, confidence_edges=edges)
        test = read_split(data, "test")
        test_touches = _read(classifier, test, "reading test touches")
        evaluation = {
            "cross_validated_nll": {str(list(edges)): loss for edges, loss in losses.items()},
            "confidence_edges": list(edges),
            "depth_and_force_accuracy": depth_and_force_accuracy(calibration, test),
            **evaluate(model, test_touches, test, np.random.default_rng(self.seed)),
        }
        classifier.save(out / CLASSIFIER_FILE)
        write_text(out / OBSERVATION_FILE, model.to_json() + "\n")
        write_text(out / "evaluation.json", json.dumps(evaluation, indent=1) + "\n")
        _show(evaluation, labels, model.calibration)
        print(f"wrote {out}")


def evaluate(
    model: ConfusionModel, touches: list[Touch], truth: TouchSet, rng: np.random.Generator
) -> dict[str, object]:
    """Accuracy and calibration of single touches and of all touches of an object fused.

    Intervals of single-touch figures resample objects, because touches of one object err together.
    """
    logits = np.stack([touch.logits for touch in touches])
    raw = TemperatureScaling().predict_proba(logits)
    calibrated = model.calibration.predict_proba(logits)
    correct = logits.argmax(axis=1) == truth.shapes
    objects, first = np.unique(truth.object_ids, return_index=True)
    object_shapes = truth.shapes[first]
    right, low, high = cluster_bootstrap(correct, truth.object_ids, rng)
    fused = log_posteriors(model, list(group_by_object(touches, truth.object_ids).values()))
    fused_probs, confusion = np.exp(fused), confusion_matrix(raw, truth.shapes)
    fused_right = int((fused.argmax(axis=1) == object_shapes).sum())
    return {
        "num_touches": len(touches),
        "num_objects": len(objects),
        "accuracy": right,
        "accuracy_interval": (low, high),
        "shapes": {k: asdict(v) for k, v in zip(model.shape_labels, shape_scores(confusion), strict=True)},
        "confusion": confusion.tolist(),
        "temperature": model.calibration.temperature,
        "nll_raw": negative_log_likelihood(raw, truth.shapes),
        "nll_calibrated": negative_log_likelihood(calibrated, truth.shapes),
        "ece_raw": expected_calibration_error(raw, truth.shapes),
        "ece_calibrated": expected_calibration_error(calibrated, truth.shapes),
        "fused_accuracy": fused_right / len(objects),
        "fused_accuracy_interval": clopper_pearson_interval(fused_right, len(objects)),
        "fused_nll": negative_log_likelihood(fused_probs, object_shapes),
        "fused_ece": expected_calibration_error(fused_probs, object_shapes),
    }


def _read(classifier: TouchClassifier, touches: TouchSet, what: str) -> list[Touch]:
    logits = read_logits(classifier, touches.images, what)
    return [Touch(int(pose), row) for pose, row in zip(touches.poses, logits, strict=True)]


def _show(evaluation: dict, labels: tuple[str, ...], calibration: TemperatureScaling) -> None:
    console = Console()
    low, high = evaluation["accuracy_interval"]
    fused_low, fused_high = evaluation["fused_accuracy_interval"]
    e = evaluation
    console.print(
        f"{e['num_touches']} test touches of {e['num_objects']} unseen objects\n"
        f"single touch: accuracy {e['accuracy']:.4f} [{low:.4f}, {high:.4f}]\n"
        f"from force and depth alone, without the image: {e['depth_and_force_accuracy']:.4f}\n"
        f"temperature {calibration.temperature:.3f} ({calibration.status}): NLL {e['nll_raw']:.4f} → "
        f"{e['nll_calibrated']:.4f}, ECE {e['ece_raw']:.4f} → {e['ece_calibrated']:.4f}\n"
        f"all touches of an object fused: accuracy {e['fused_accuracy']:.4f} [{fused_low:.4f}, {fused_high:.4f}], "
        f"NLL {e['fused_nll']:.4f}, ECE {e['fused_ece']:.4f}"
    )
    table = Table(title="true shape (rows) against predicted shape")
    for heading in ("", *labels, "precision", "recall", "F1"):
        table.add_column(heading, justify="right")
    for label, row in zip(labels, e["confusion"], strict=True):
        score = e["shapes"][label]
        ratios = (f"{score[name]:.3f}" for name in ("precision", "recall", "f1"))
        table.add_row(label, *map(str, row), *ratios)
    console.print(table)
