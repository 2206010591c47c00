"""The paper's Table 1 for two splits of the same images: by image and by object (paper §5.6, §6.2).

The paper does not say how it made its 80/20 split. In a split by image, the training set contains near copies of test
images: windows of the same press. Both classifiers are also tested on other objects. A nearest-neighbour classifier on
pixels shows the accuracy that near copies alone give.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from activetouch.data.dataset import TouchSet
from activetouch.data.images import window_images
from activetouch.orientations import Resampled
from activetouch.perception.reader import resized
from activetouch.perception.recipe import RECIPES, TrainingRecipe
from activetouch.scene import Scene
from belief.metrics import ShapeScore, shape_scores
from belief.seeding import keyed_rng
from belief.table import Table, interval
from experiments.parallel import run_tasks
from experiments.sensor.scores import accuracy_of_objects
from experiments.sensor.train import STATE_FILE, card_for, new_classifier, run_to_the_end

if TYPE_CHECKING:
    from activetouch.perception.classifier import TouchClassifier


@dataclass(frozen=True)
class WindowPlan:
    """Size of the data set; the default has 700 images of each shape, about as many as the paper."""

    objects: int = 35
    """Number of objects of each shape, of different sizes."""
    presses: int = 2
    """Number of presses of each object, each in a new random orientation."""
    images: int = 10
    """Number of images of each press, evenly spread over the time of contact."""
    seed: int = 0
    """Seed of all random numbers."""


def record_windows(scene: Scene, plan: WindowPlan, stream: int, jobs: int) -> TouchSet:
    """Press the objects of a plan and render the windows, on several processes; streams are independent data sets.

    Images are ordered by object, shapes in turn; ``poses`` numbers the presses of an object. An object that misses the
    pad has no images.
    """
    scene = replace(scene, presentation=Resampled())
    tasks = [partial(_press, scene, plan, stream, number) for number in range(plan.objects * len(scene.shapes))]
    parts = [part for part in run_tasks(tasks, jobs, "sliding windows over presses") if len(part.images)]
    return TouchSet.join(sorted(parts, key=lambda part: part.object_ids[0]))


def _press(scene: Scene, plan: WindowPlan, stream: int, number: int) -> TouchSet:
    rng = keyed_rng([plan.seed, stream, number], is_fixed_length=True)
    body = scene.sample_object(number % len(scene.shapes), rng)
    images: list[NDArray[np.uint8]] = []
    rows: list[Sequence[float]] = []
    for press in range(plan.presses):
        contact = scene.contact(scene.place(body, 0, rng), rng)
        taken = window_images(scene, contact, plan.images, rng)
        images += taken
        rows += [(body.shape_index, number, press, contact.force, contact.depth)] * len(taken)
    shapes, object_ids, presses, forces, depths = np.reshape(rows, (-1, 5)).T
    stack = np.reshape(images, (-1, *scene.image_shape)).astype(np.uint8)
    return TouchSet(stack, shapes.astype(int), object_ids.astype(int), presses.astype(int), forces, depths)


def split_by_image(touches: TouchSet, share: float, rng: np.random.Generator) -> tuple[TouchSet, TouchSet]:
    """A random ``share`` of the images, and the others. Near copies are in both parts."""
    order = rng.permutation(len(touches.images))
    cut = round(share * len(order))
    return touches.select(np.sort(order[:cut])), touches.select(np.sort(order[cut:]))


def split_by_object(touches: TouchSet, share: float, rng: np.random.Generator) -> tuple[TouchSet, TouchSet]:
    """The images of a random ``share`` of each shape's objects, and those of the others."""
    first: list[NDArray[np.int64]] = []
    for shape in np.unique(touches.shapes):
        objects = rng.permutation(np.unique(touches.object_ids[touches.shapes == shape]))
        first.append(objects[: round(share * len(objects))])
    chosen = np.isin(touches.object_ids, np.concatenate(first))
    return touches.select(chosen), touches.select(~chosen)


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
"""Table 1 as printed; overall accuracy 0.81."""


@dataclass(frozen=True)
class Result:
    """Scores of one classifier on one set of images, with 95 % intervals over objects.

    ``confusion`` counts (true shape, predicted shape); ``nearest`` is the accuracy of the nearest training image.
    """

    accuracy: float
    interval: tuple[float, float]
    confusion: list[list[int]]
    nearest: float
    nearest_interval: tuple[float, float]

    def to_dict(self, labels: tuple[str, ...]) -> dict[str, Any]:
        """The result as plain values, with the scores of every shape."""
        scores = zip(labels, shape_scores(self.confusion), strict=True)
        return {**asdict(self), "shapes": {label: asdict(score) for label, score in scores}}


@dataclass(frozen=True)
class Settings:
    """Number of images and the training of both classifiers, by default the paper's; ``input_size`` in pixels.

    ``weights`` are those of :class:`experiments.sensor.train.Train`; random ones by default.
    """

    images: WindowPlan = field(default_factory=WindowPlan)
    backbone: str = "tiny"
    input_size: int = 128
    recipe: TrainingRecipe = RECIPES["paper"]
    weights: str | None = None


def both_splits(
    settings: Settings, scene: Scene, images: TouchSet, others: TouchSet, seed: int, folder: Path
) -> dict[str, dict[str, Result]]:
    """Train a classifier on each split; test it on the images held out by the split and on those of held-out objects.

    Trainings are kept in a folder and continued. Results are by split, and by "held out" and "held-out objects".
    """
    from activetouch.perception.training import Trainer  # loads torch

    results = {}
    for name, split in SPLITS.items():
        train, held_out = split(images, SHARE, np.random.default_rng(seed))
        card = card_for(train, settings.backbone, settings.input_size, scene.shape_labels, scene.pose_labels)
        state = folder / name.replace(" ", "-") / STATE_FILE
        classifier = new_classifier(card, settings.recipe.seed, settings.weights)
        trainer = Trainer(classifier, settings.recipe, train, held_out, state, scene.symmetry)
        run_to_the_end(trainer)
        classifier = trainer.finish()
        results[name] = {
            what: _read(classifier, train, touches, np.random.default_rng(seed))
            for what, touches in (("held out", held_out), ("held-out objects", others))
        }
    return results


def _read(classifier: TouchClassifier, train: TouchSet, touches: TouchSet, rng: np.random.Generator) -> Result:
    labels = classifier.read(touches.images).labels
    accuracy, low, high = accuracy_of_objects(labels == touches.shapes, touches.object_ids, rng)
    num_shapes = len(classifier.card.shape_labels)
    confusion = np.zeros((num_shapes, num_shapes), int)
    np.add.at(confusion, (touches.shapes, labels), 1)
    copied = nearest_image_guesses(train, touches) == touches.shapes
    nearest, *interval = accuracy_of_objects(copied, touches.object_ids, rng)
    return Result(accuracy, (low, high), confusion.tolist(), nearest, (interval[0], interval[1]))


def nearest_image_guesses(known: TouchSet, test: TouchSet, size: int = 32) -> NDArray[np.int64]:
    """Shape of the known image nearest to each test image, pixel by pixel, ``(m,)``; averaged to ``size`` pixels."""
    small = (resized(touches.images, (size, size, *touches.images.shape[3:])) for touches in (test, known))
    first, second = (images.reshape(len(images), -1).astype(float) for images in small)
    return known.shapes[cdist(first, second).argmin(axis=1)]


def table(results: Mapping[str, Mapping[str, Result]], labels: Sequence[str]) -> Table:
    """The paper's table and ours: precision / recall / F1 (support) of every shape, then accuracies."""
    columns = {f"{name}, {what}": result for name, row in results.items() for what, result in row.items()}
    scores = [dict(zip(labels, shape_scores(result.confusion), strict=True)) for result in columns.values()]
    rows = [(label, _cell(printed), *(_cell(one[label]) for one in scores)) for label, printed in PAPER.items()]
    rows.append(("accuracy", "0.81", *(interval(one.accuracy, *one.interval) for one in columns.values())))
    nearest = (interval(one.nearest, *one.nearest_interval) for one in columns.values())
    rows.append(("accuracy of the nearest training image", "", *nearest))
    return Table("", ["", "paper", *columns], rows, name="table1")


def _cell(score: ShapeScore) -> str:
    return f"{score.precision:.2f} / {score.recall:.2f} / {score.f1:.2f} ({score.support})"
