"""The paper's Table 1, twice: the same images and training, split by image and split by object (paper §5.6, §6.2).

The paper does not say how it split its 80/20. If by image, near copies of a test image, windows of the same press, were
learned from. Both classifiers are also shown images of objects that neither has seen, which says what each knows; and
the label of the nearest training image, pixel by pixel, says how much there is to be had from near copies alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from activetouch.data.dataset import TouchSet
from activetouch.perception.classifier import TouchClassifier
from activetouch.perception.recipe import TrainingRecipe
from activetouch.perception.training import Trainer
from activetouch.scene import Scene
from belief.metrics import ShapeScore, shape_scores
from belief.statistics import cluster_bootstrap
from experiments.paper.sliding_windows import split_by_image, split_by_object
from experiments.sensor.baseline import nearest_image_guesses
from experiments.sensor.train import STATE_FILE, card_for, new_classifier, run_to_the_end

Split = Callable[[TouchSet, float, np.random.Generator], tuple[TouchSet, TouchSet]]
SPLITS: Mapping[str, Split] = MappingProxyType({"by image": split_by_image, "by object": split_by_object})
SHARE = 0.8

PAPER = MappingProxyType(
    {
        "cone": ShapeScore(0.77, 0.79, 0.78, 144),
        "cube": ShapeScore(0.77, 0.80, 0.78, 144),
        "cylinder": ShapeScore(0.71, 0.67, 0.69, 141),
        "sphere": ShapeScore(1.00, 1.00, 1.00, 131),
    }
)
"""Table 1 as printed; overall accuracy .81."""


@dataclass(frozen=True)
class Result:
    """What one classifier read of one set of images.

    Attributes:
        accuracy: share of images read correctly.
        interval: of the accuracy, 95 %, resampling objects.
        confusion: counts of (true shape, predicted shape).
        nearest: share of images whose nearest training image has their shape.
        nearest_interval: of that.
    """

    accuracy: float
    interval: tuple[float, float]
    confusion: list[list[int]]
    nearest: float
    nearest_interval: tuple[float, float]

    def to_dict(self, labels: tuple[str, ...]) -> dict[str, Any]:
        """Plain values, with the scores of every shape."""
        scores = zip(labels, shape_scores(self.confusion), strict=True)
        return {**asdict(self), "shapes": {label: asdict(score) for label, score in scores}}


@dataclass(frozen=True)
class Training:
    """How both classifiers are made.

    Attributes:
        scene: whose images.
        backbone: a key of :data:`activetouch.perception.backbones.BACKBONES`.
        input_size: edge the network sees [pixels].
        recipe: optimiser settings.
        weights: where the backbone starts from; random without.
        folder: for the states of both trainings.
    """

    scene: Scene
    backbone: str
    input_size: int
    recipe: TrainingRecipe
    weights: str | None
    folder: Path

    def classifier(self, name: str, train: TouchSet, held_out: TouchSet) -> TouchClassifier:
        """The classifier of a split, trained to the end from where its state file stands."""
        card = card_for(train, self.backbone, self.input_size, self.scene.shape_labels, self.scene.pose_labels)
        state = self.folder / name.replace(" ", "-") / STATE_FILE
        trainer = Trainer(
            new_classifier(card, self.recipe.seed, self.weights),
            self.recipe,
            train,
            held_out,
            state,
            self.scene.symmetry,
        )
        run_to_the_end(trainer, state.parent / "tensorboard")
        return trainer.finish()


def both_splits(training: Training, images: TouchSet, fresh: TouchSet, seed: int) -> dict[str, dict[str, Result]]:
    """Train on each split, and read its own held-out images and the fresh ones.

    Args:
        training: how.
        images: to be split 80/20.
        fresh: images of other objects.
        seed: of the splits and of the intervals.

    Returns:
        Result by split, and by "held out" and "fresh objects".
    """
    results = {}
    for name, split in SPLITS.items():
        train, held_out = split(images, SHARE, np.random.default_rng(seed))
        classifier = training.classifier(name, train, held_out)
        results[name] = {
            what: _read(classifier, train, touches, np.random.default_rng(seed))
            for what, touches in (("held out", held_out), ("fresh objects", fresh))
        }
    return results


def _read(classifier: TouchClassifier, train: TouchSet, touches: TouchSet, rng: np.random.Generator) -> Result:
    labels = classifier.read(touches.images).labels
    accuracy, low, high = cluster_bootstrap(labels == touches.shapes, touches.object_ids, rng)
    num_shapes = len(classifier.card.shape_labels)
    confusion = np.zeros((num_shapes, num_shapes), int)
    np.add.at(confusion, (touches.shapes, labels), 1)
    copied = nearest_image_guesses(train, touches) == touches.shapes
    nearest, *interval = cluster_bootstrap(copied, touches.object_ids, rng)
    return Result(accuracy, (low, high), confusion.tolist(), nearest, (interval[0], interval[1]))


def to_markdown(results: dict[str, dict[str, Result]], labels: tuple[str, ...]) -> str:
    """The paper's table with ours beside it: precision / recall / F1 (support) of every shape."""
    columns = {f"{name}, {what}": result for name, row in results.items() for what, result in row.items()}
    lines = ["| | paper | " + " | ".join(columns) + " |", "|---" * (len(columns) + 2) + "|"]
    scores = {name: dict(zip(labels, shape_scores(r.confusion), strict=True)) for name, r in columns.items()}
    for label, printed in PAPER.items():
        cells = [printed, *(scores[name][label] for name in columns)]
        lines.append(f"| {label} | " + " | ".join(map(_cell, cells)) + " |")
    ours = [f"**{r.accuracy:.3f}** [{r.interval[0]:.3f}, {r.interval[1]:.3f}]" for r in columns.values()]
    lines.append("| accuracy | **.81** | " + " | ".join(ours) + " |")
    nearest = [f"{r.nearest:.3f} [{r.nearest_interval[0]:.3f}, {r.nearest_interval[1]:.3f}]" for r in columns.values()]
    lines.append("| of the nearest training image | | " + " | ".join(nearest) + " |")
    return "\n".join(lines) + "\n"


def _cell(score: ShapeScore) -> str:
    return f"{score.precision:.2f} / {score.recall:.2f} / {score.f1:.2f} ({score.support})"
