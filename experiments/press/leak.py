"""``activetouch leak``: how much of the accuracy comes from the force and depth of a press instead of its geometry.

The accuracy of the classifier is compared with:

* predictions from force, from depth and from both, without an image;
* its accuracy on *exchanged* images, which show the geometry of one touch with the force and depth of another. They are
  scored with the shape of the geometry (force and depth are shuffled) and with the other shape (geometry is removed);
* small networks trained on each kind of image, because a network may fail on images it was not trained on.

For recorded touches of real objects (``--recorded.data``), the accuracy on later recordings or unseen objects is
compared with random splits, with scalar features, and with features from where nothing was touched.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch.data.dataset import TouchSet
from activetouch.errors import WrongPress
from activetouch.extras import require_extra
from activetouch.perception.reader import TactileReader
from activetouch.perception.recipe import RECIPES, TrainingRecipe
from activetouch.pressing.contact import Contact, with_numbers_of
from activetouch.recorded.formats import Format
from activetouch.rendering import read_out
from activetouch.scene import Scene
from activetouch.sensor_files import READER_FILE
from belief.claims import claim_folder, ends_claims
from belief.files import write_text
from belief.seeding import keyed_rng
from belief.statistics import paired_bootstrap
from experiments.command_line.arguments import Count, CountOrNone, Jobs, Pixels, Seed, Within, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs, run_tasks
from experiments.recorded.leaks import leaks_of
from experiments.reporting.tables import Table, interval
from experiments.scene_choice import SceneChoice, in_file_names, named_scene
from experiments.sensor.baseline import averaged, share_by_object, shares_without_image
from experiments.sensor.scores import accuracy_of_objects
from experiments.sensor.train import Changes, card_for, new_classifier, require_input_size, run_to_the_end
from experiments.sensor_choice import check_sensor, sensor_folder, tell_shift

Floats = NDArray[np.float64]
Images = NDArray[np.uint8]
Integers = NDArray[np.int64]
Shares = dict[str, dict[str, Floats]]  # of right answers for every object, by who answers and what it is shown
Key = tuple[int, int]
Readings = Mapping[str, Callable[[Images], NDArray[Any]]]

PLAIN, SHUFFLED, REMOVED = "touch as it is", "force and depth of another touch", "geometry of another touch"
NO_IMAGE, CLASSIFIER, _SMALL = "nearest neighbours, no image", "classifier", "small network, trained on: "
_PER_TASK = 48
_KEY = 0x1EAF  # so that generators differ from those of collections and episodes with the same seed
_TEST, _TRAIN, _INTERVALS = range(3)


@dataclass(frozen=True, eq=False)
class Exchanged:
    """N touches, each with its own image and an exchanged image.

    Attributes:
        shapes: of the objects, ``(N,)``.
        object_ids, poses: of the touches, ``(N,)``.
        lenders: the touches that give force and depth to the exchanged images, a permutation, ``(N,)``.
        numbers: force [N] and depth [m], ``(N, 2)``.
        plain: readings of the own images by name, N rows each.
        lent: readings of the exchanged images.
    """

    shapes: Integers
    object_ids: Integers
    poses: Integers
    lenders: Integers
    numbers: Floats
    plain: Mapping[str, NDArray[Any]]
    lent: Mapping[str, NDArray[Any]]

    def labelled(self, kind: str) -> TouchSet:
        """The images of one kind, from the reading "image", with the labels that they are scored with."""
        labels = self.lenders if kind == REMOVED else np.arange(len(self.lenders))
        columns = (self.shapes, self.object_ids, self.poses, *self.numbers.T)
        return TouchSet((self.plain if kind == PLAIN else self.lent)["image"], *(column[labels] for column in columns))


@dataclass(frozen=True)
class RecordedSet:
    """Recorded touches, whose leak controls are measured instead of those of a scene."""

    data: Path | None = None
    """Folder of the recordings; for npz also the file."""
    format: Format = "csv"
    """Format of the recordings."""
    task: Literal["objects", "categories", "shapes"] = "objects"
    """Labels: objects are tested on later recordings, categories and shapes on objects that were not learned from."""
    folds: Annotated[int, Within(2, 100)] = 5
    """Folds of objects for categories and shapes."""
    random_splits: Count = 3
    """Random splits."""
    leave_out_incomplete: bool = False
    """Leave out objects with too few sessions of an action, instead of refusing the set."""


@dataclass(frozen=True)
class Leak:
    """Measure how well force and depth predict the shape, and how much of the classifier's accuracy comes from them.

    Recorded touches of real objects are read from random splits, scalars, and where nothing was touched.

    For example:

        activetouch leak --scene paper
        activetouch leak --renderer gelsight --train 400
        activetouch leak --recorded.data my_touches --recorded.format csv
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    recorded: RecordedSet = field(default_factory=RecordedSet)
    """Recorded touches instead of a world."""
    sensor: Path | None = None
    """Folder of a sensor, or name of a shipped one; by default the scene's, if it fits the images and shapes."""
    objects: Annotated[int, Within(2, 10**8)] = 150
    """Number of objects of every shape to measure on; each is touched once in every pose."""
    train: CountOrNone = 0
    """Number of objects of every shape to train small networks on; 0 for no training."""
    input_size: Pixels = 32
    """Edge of the averaged images that small networks see [pixels]."""
    change: Changes = field(default_factory=Changes)
    """Changes to their training recipe, which is "large" in single precision, without early stopping."""
    seed: Seed = 0
    """Seed of objects, presses, exchange and intervals."""
    out: Path | None = None
    """Folder for leak.json and leak.md; runs/leak-SCENE or runs/leak-FORMAT-TASK by default."""
    anyway: bool = False
    """Use the sensor in a scene that it was not made for."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes that press; the results do not depend on it."""

    @ends_claims
    def run(self) -> None:
        """Touch, classify, train if requested, print and write."""
        check_arguments(self)
        if self.recorded.data is not None:
            self._recorded(self.recorded.data)
        else:
            self._simulated()

    def _simulated(self) -> None:
        scene = self.choice.named.scene
        if self.train:
            require_extra("train")
            require_input_size(self.input_size, scene.image_shape[0], "cnn")
        out = self.out if self.out is not None else Path(f"runs/leak-{in_file_names(self.choice.scene)}")
        claim_folder(out)
        classifier = self._classifier(scene)
        readings: dict[str, Any] = {"image": partial(averaged, size=self.input_size)} if self.train else {}
        if classifier is not None:
            readings[CLASSIFIER] = lambda images: classifier.read(images).labels
        touched = exchange(scene, self.objects, (self.seed, _TEST), readings, self.jobs)
        shares = {NO_IMAGE: shares_without_image(touched.numbers, touched.shapes, touched.object_ids)}
        if classifier is not None:
            shares[CLASSIFIER] = judged(touched, touched.plain[CLASSIFIER], touched.lent[CLASSIFIER])
        if self.train:
            shares |= self._small_networks(scene, touched)
        rng = keyed_rng([self.seed, _KEY, _INTERVALS], is_fixed_length=True)
        result = {
            "scene": self.choice.to_dict(),
            "renderer": repr(scene.renderer),
            "sensor": None if classifier is None else str(self.sensor or self.choice.scene),
            "seed": self.seed,
            "objects_per_shape": self.objects,
            "num_objects": self.objects * len(scene.shapes),
            "num_touches": len(touched.shapes),
            "training": {"objects_per_shape": self.train, **asdict(self._recipe)} if self.train else None,
            "chance": 1 / len(scene.shapes),
            "accuracy": {
                who: {shown: accuracy_of_objects(right, np.arange(len(right)), rng) for shown, right in rights.items()}
                for who, rights in shares.items()
            },
            "differences": {name: paired_bootstrap(*pair, rng) for name, pair in _pairs(shares).items()},
        }
        _write(result, out)

    def _recorded(self, data: Path) -> None:
        require_extra("recorded")
        own = self.recorded
        out = self.out if self.out is not None else Path(f"runs/leak-{own.format}-{own.task}")
        claim_folder(out)
        leaks_of(data, own.format, own.task, own.folds, own.random_splits, own.leave_out_incomplete, self.seed, out)

    @property
    def _recipe(self) -> TrainingRecipe:
        return self.change.of(replace(RECIPES["large"], patience=None, bf16=False))

    def _classifier(self, scene: Scene) -> TactileReader | None:
        own = named_scene(self.choice.scene).scene
        if self.sensor is None and (own.renderer != scene.renderer or own.shape_labels != scene.shape_labels):
            print(f"{self.choice.scene} has no sensor for these images and shapes; give one with --sensor")
            return None
        folder = sensor_folder(self.sensor, self.choice.scene)
        tell_shift(check_sensor(folder, self.choice, self.anyway))
        return TactileReader.load(folder / READER_FILE)

    def _small_networks(self, scene: Scene, test: Exchanged) -> Shares:
        """Fractions of correct answers of networks trained on each kind of image."""
        from activetouch.perception.training import Trainer  # loads torch

        kept, shares = {"image": partial(averaged, size=self.input_size)}, {}
        known = exchange(scene, self.train, (self.seed, _TRAIN), kept, self.jobs)
        for kind in (PLAIN, SHUFFLED, REMOVED):
            learned, checked = known.labelled(kind), test.labelled(kind)  # the latter for reports only
            card = card_for(learned, "cnn", self.input_size, scene.shape_labels, scene.pose_labels)
            classifier = new_classifier(card, self._recipe.seed)
            with tempfile.TemporaryDirectory() as out:
                trainer = Trainer(classifier, self._recipe, learned, checked, Path(out, "state"), scene.symmetry)
                run_to_the_end(trainer, Path(out, "tensorboard"))
            plain, lent = (trainer.finish().read(seen["image"]).labels for seen in (test.plain, test.lent))
            shares[_SMALL + kind] = judged(test, plain, lent)
        return shares


def exchange(scene: Scene, num_objects: int, key: Key, readings: Readings, jobs: int = 1) -> Exchanged:
    """Touch new objects in every pose, and apply readings to the own and the exchanged images.

    Args:
        scene: the world.
        num_objects: of every shape.
        key: seed and stream of the generators.
        readings: functions from images ``(n, …)`` to n rows, by name.
        jobs: number of processes that press.

    Raises:
        WrongPress: geometry and depth do not determine the imprints of the scene.
    """
    if scene.press_model.deforms:
        raise WrongPress(
            "geometry and depth do not determine the imprint on a deformable pad; choose --fidelity quasistatic, "
            "dynamic or guarded_move"
        )
    touches = np.arange(num_objects * len(scene.shapes) * len(scene.poses))
    lenders = keyed_rng([*key, _KEY], is_fixed_length=True).permutation(len(touches))
    tasks = [
        partial(_touch_some, scene, key, touches[first : first + _PER_TASK], lenders[first : first + _PER_TASK])
        for first in range(0, len(touches), _PER_TASK)
    ]
    parts: list[tuple[Any, ...]] = []
    for first, numbers, *images in run_tasks(tasks, jobs, "touching, each touch for itself and with a lender"):
        parts.append((first, numbers, *({name: read(seen) for name, read in readings.items()} for seen in images)))
    _, values, plain, lent = zip(*sorted(parts, key=lambda part: part[0]), strict=True)
    object_ids = touches // len(scene.poses)
    return Exchanged(
        object_ids % len(scene.shapes),
        object_ids,
        touches % len(scene.poses),
        lenders,
        np.concatenate(values),
        *({name: np.concatenate([part[name] for part in seen]) for name in readings} for seen in (plain, lent)),
    )


def _touch_some(scene: Scene, key: Key, touches: Integers, lenders: Integers) -> tuple[int, Floats, Images, Images]:
    numbers: list[tuple[float, float]] = []
    plain: list[Any] = []
    lent: list[Any] = []
    for touch, lender in zip(touches.tolist(), lenders.tolist(), strict=True):
        (contact, stiffness), (other, _) = _press(scene, key, touch), _press(scene, key, lender)
        numbers.append((contact.force, contact.depth))
        for images, shown in ((plain, contact), (lent, with_numbers_of(other, contact, stiffness))):
            images.append(read_out(scene.image(shown), scene.faults, keyed_rng([*key, _KEY, touch, 1])))
    return int(touches[0]), np.array(numbers), np.stack(plain), np.stack(lent)


def _press(scene: Scene, key: Key, touch: int) -> tuple[Contact, float]:
    """The contact with a number and the stiffness of its object; equal arguments give equal results."""
    number, pose = divmod(touch, len(scene.poses))
    thing = scene.sample_object(number % len(scene.shapes), keyed_rng([*key, _KEY, number, 2]))
    rng = keyed_rng([*key, _KEY, touch, 3])
    return scene.press(thing, pose, rng).contact, thing.stiffness


def judged(touched: Exchanged, plain: Integers, lent: Integers) -> dict[str, Floats]:
    """Fraction of correct predictions for every object, by kind of image.

    Args:
        touched: the touches.
        plain: shapes predicted from the own images, ``(N,)``.
        lent: shapes predicted from the exchanged images, ``(N,)``.
    """
    shapes, ids, lenders = touched.shapes, touched.object_ids, touched.lenders
    return {
        PLAIN: share_by_object(plain == shapes, ids),
        SHUFFLED: share_by_object(lent == shapes, ids),
        REMOVED: share_by_object(lent == shapes[lenders], ids[lenders]),
    }


def _pairs(shares: Shares) -> dict[str, tuple[Floats, Floats]]:
    """Paired comparisons: every reader with itself on exchanged images, and with predictions without an image."""
    pairs = {}
    for who, rights in shares.items():
        if who != NO_IMAGE:
            pairs[f"{who}: {PLAIN} − {SHUFFLED}"] = rights[PLAIN], rights[SHUFFLED]
            pairs[f"{who}: {PLAIN} − no image, force and depth"] = rights[PLAIN], shares[NO_IMAGE]["force and depth"]
    own = [shares[_SMALL + kind][kind] for kind in (PLAIN, SHUFFLED) if _SMALL + kind in shares]
    return pairs | ({f"small networks, each as it was trained: {PLAIN} − {SHUFFLED}": (own[0], own[1])} if own else {})


def _write(result: dict[str, Any], out: Path) -> None:
    """Print the result, and write it as JSON and Markdown."""
    measured = Table(
        "Fraction of correct answers",
        ("reader", "images", "correct [95 %]"),
        [
            (who, shown, interval(*right))
            for who, rights in result["accuracy"].items()
            for shown, right in rights.items()
        ],
    )
    compared = Table(
        "Differences",
        ("difference", "correct [95 %]"),
        [(name, interval(*difference, spec="+.3f")) for name, difference in result["differences"].items()],
    )
    heading = (
        f"{result['scene']['scene']}, {result['renderer']}, seed {result['seed']}: fraction of correct "
        f"answers for {result['num_touches']} touches of {result['num_objects']} objects; intervals resample objects. "
        f"Chance is {result['chance']:.3f}. With the geometry of another touch, the correct shape is that of the touch "
        "that gives force and depth."
    )
    write_text(out / "leak.json", json.dumps(result, indent=1) + "\n")
    write_text(out / "leak.md", "\n\n".join([heading, measured.markdown(), compared.markdown()]) + "\n")
    plain_console().print(heading, measured.rich(), compared.rich())
    print(f"wrote leak.json and leak.md into {out}")
