"""The world a search touches: real presses, read by the trained classifier.

    sensor = TactileSensor.shipped("gel")                       # scene, classifier and observation model
    world = TouchWorld.sample(sensor, arrangement=(2, 0, 3, 1), rng=np.random.default_rng(0))
    touch = world.touch(pose=0, rng=np.random.default_rng(1))

Many worlds are touched at once with :meth:`TactileSensor.touch_many`: presses one after the other, then one pass of the
network over all images. It also keeps the time each part took.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import LabelMismatch, SceneShift
from activetouch.named_scenes import SCENES
from activetouch.perception.card import ClassifierCard, read_card
from activetouch.rendering import read_out
from activetouch.scene import Scene, WorldObject
from activetouch.scene_description import in_words, require_scene, scene_fields
from belief import Touch
from belief.errors import CorruptFile, UnknownName
from belief.files import write_text
from belief.observation_model import ArrayModel, read_observation_model, read_origin

if TYPE_CHECKING:
    from activetouch.perception.classifier import TouchClassifier

MODELS = Path(__file__).parent / "models"
CLASSIFIER_FILE, OBSERVATION_FILE = "classifier.safetensors", "observation_model.json"
POLICIES = "policies"  # folder of trained policies beside the two


@dataclass
class TouchTime:
    """Seconds spent on touches so far, by part, and presses that did not settle and were made again."""

    physics: float = 0.0
    network: float = 0.0
    pressed_again: int = 0


class TouchRequest(Protocol):
    """A touch that some episode waits for."""

    @property
    def world(self) -> TouchWorld:
        """Whose current object to touch."""

    @property
    def pose(self) -> int:
        """In which pose."""

    @property
    def rng(self) -> np.random.Generator:
        """The nuisances' source of chance."""


def load_observation_model(folder: Path) -> ArrayModel:
    """The observation model of the sensor in a folder.

    Raises:
        CorruptFile: it is damaged, was changed since, or is missing.
    """
    return observation_model_and_scene(folder)[0]


def write_observation_model(folder: Path, model: ArrayModel, scene: Mapping[str, Any]) -> None:
    """Write the observation model of a sensor.

    Args:
        folder: of the sensor.
        model: the model.
        scene: fields of the scene that its touches come from (:func:`activetouch.scene_description.scene_fields`).
    """
    write_text(folder / OBSERVATION_FILE, model.to_json({"scene": scene}) + "\n")


def sensor_shift(folder: Path, scene: Scene, anyway: bool = False) -> tuple[str, ...]:
    """How a scene differs from the one that the sensor in a folder was made for, found without loading its network.

    Args:
        folder: of classifier and observation model.
        scene: in which it is to be used.
        anyway: whether to use it whatever the differences are, as long as its network can read the images at all.

    Returns:
        The differences, in words: known shifts, and with ``anyway`` all others too; none for the sensor's own scene.

    Raises:
        CorruptFile: one of the files is damaged or missing.
        LabelMismatch: it was made for other shapes or poses than the scene's.
        WrongScene: it was made for a scene that differs by more than a known shift.
    """
    card = read_card(folder / CLASSIFIER_FILE)
    return _shift(folder, card, *observation_model_and_scene(folder), scene, anyway)


def observation_model_and_scene(folder: Path) -> tuple[ArrayModel, Mapping[str, Any] | None]:
    """The observation model in a folder, and the fields of the scene it was fitted to, if it says so.

    Raises:
        CorruptFile: it is damaged, was changed since, or is missing.
    """
    path = folder / OBSERVATION_FILE
    try:
        text = path.read_text(encoding="utf-8")
        scene = (read_origin(text) or {}).get("scene")
        if not (scene is None or isinstance(scene, dict)):
            raise ValueError(f"its scene is {scene!r}")
        return read_observation_model(text), scene
    except OSError as error:
        raise CorruptFile(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise CorruptFile(f"{path} is no observation model: {error}") from error


def _shift(
    folder: Path,
    card: ClassifierCard,
    model: ArrayModel,
    fitted_to: Mapping[str, Any] | None,
    scene: Scene,
    anyway: bool,
) -> tuple[str, ...]:
    """See :func:`sensor_shift`."""
    card.require_labels(scene.shape_labels, scene.pose_labels)
    _require_model(model, scene)
    here = scene_fields(scene)
    found = require_scene(f"the classifier in {folder}", card.scene, here, anyway)
    card.require_images(scene.image_shape)
    return tuple(dict.fromkeys(found + require_scene(f"the observation model in {folder}", fitted_to, here, anyway)))


def _require_model(model: ArrayModel, scene: Scene) -> None:
    shapes, poses = scene.shape_labels, scene.pose_labels
    if model.shape_labels != shapes or model.num_poses != len(poses):
        raise LabelMismatch(
            f"the observation model is about the shapes {list(model.shape_labels)} in {model.num_poses} poses, the "
            f"scene has {list(shapes)} in {len(poses)}; this scene needs an observation model of its own"
        )


@dataclass(frozen=True, eq=False)
class TactileSensor:
    """A scene with the classifier trained for it and the observation model fitted to both.

    Attributes:
        scene: where presses come from.
        classifier: reads their images.
        model: turns what it reads into evidence.
        time: seconds spent so far.
        shift: how the scene differs from the one that classifier and model were made for, in words; empty where it is
            the same.

    Raises:
        LabelMismatch: classifier or observation model were made for other shapes or poses.
    """

    scene: Scene
    classifier: TouchClassifier
    model: ArrayModel
    time: TouchTime = field(default_factory=TouchTime)
    shift: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.classifier.card.require_labels(self.scene.shape_labels, self.scene.pose_labels)
        _require_model(self.model, self.scene)

    @classmethod
    def load(cls, folder: Path, scene: Scene, anyway: bool = False) -> TactileSensor:
        """The sensor whose classifier and observation model lie in a folder.

        A scene that differs from theirs by another press, other faults, sizes, forces or orientations is a known shift:
        a warning and :attr:`shift` tell it.

        Args:
            folder: of the two.
            scene: in which to use it.
            anyway: whether to use it, without a warning, in a scene that it was not made for.

        Raises:
            CorruptFile: one of the files is damaged or missing.
            LabelMismatch: they were made for other shapes or poses than the scene's.
            WrongScene: they were made for a scene that differs by more than a known shift.
        """
        from activetouch.perception.classifier import TouchClassifier  # loads torch

        model, fitted_to = observation_model_and_scene(folder)
        classifier = TouchClassifier.load(folder / CLASSIFIER_FILE)
        shift = _shift(folder, classifier.card, model, fitted_to, scene, anyway)
        if shift and not anyway:
            warnings.warn(
                f"the sensor in {folder} is used outside the scene it was made for: {in_words(shift)}",
                SceneShift,
                stacklevel=2,
            )
        return cls(scene, classifier, model, shift=shift)

    @classmethod
    def shipped(cls, name: str = "gel", scene: Scene | None = None, anyway: bool = False) -> TactileSensor:
        """A sensor that comes with the package, by name, on the scene of that name or on another. See :meth:`load`."""
        known = sorted(folder.name for folder in MODELS.iterdir() if folder.is_dir())
        if name not in known:
            raise UnknownName("sensor", name, known)
        return cls.load(MODELS / name, scene if scene is not None else SCENES[name].scene, anyway)

    def read(self, images: NDArray[np.uint8], poses: Sequence[int]) -> list[Touch]:
        """Touches from images ``(N, H, W)`` and the poses they were felt in."""
        logits, features = self.classifier.read(images)
        return [Touch(int(pose), row, feature) for pose, row, feature in zip(poses, logits, features, strict=True)]

    def touch_many(self, requests: Sequence[TouchRequest]) -> list[Touch]:
        """Press for every request, then read all images in one pass."""
        started = time.perf_counter()
        images = np.stack([request.world.press(request.pose, request.rng) for request in requests])
        pressed = time.perf_counter()
        touches = self.read(images, [request.pose for request in requests])
        self.time.physics += pressed - started
        self.time.network += time.perf_counter() - pressed
        return touches


class TouchWorld:
    """Objects on their guides, one at a time in front of the pad.

    Args:
        sensor: presses and reads.
        objects: in order of visit.
    """

    def __init__(self, sensor: TactileSensor, objects: Sequence[WorldObject]) -> None:
        self._sensor = sensor
        self._objects = tuple(objects)
        self._current = 0

    @classmethod
    def sample(cls, sensor: TactileSensor, arrangement: Sequence[int], rng: np.random.Generator) -> TouchWorld:
        """Objects of the given shapes, with random sizes and orientations."""
        return cls(sensor, [sensor.scene.sample_object(shape, rng) for shape in arrangement])

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shape of every object, in order of visit; for scoring only."""
        return tuple(thing.shape_index for thing in self._objects)

    def press(self, pose: int, rng: np.random.Generator) -> NDArray[np.uint8]:
        """The image of the current object pressed in a pose.

        A press that does not settle is made again with new offset and force, from the same source of chance, and
        counted in the sensor's time (decision 0020).

        Raises:
            UnstablePress: again and again it did not settle.
        """
        scene = self._sensor.scene
        _, contact, again = scene.settled_contact(self._objects[self._current], pose, rng)
        self._sensor.time.pressed_again += again
        return read_out(scene.image(contact), scene.faults, rng)

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """Press the current object and read the image."""
        return self._sensor.read(self.press(pose, rng)[None], [pose])[0]

    def advance(self) -> None:
        """Put the current object aside and bring the next."""
        if self._current + 1 == len(self._objects):
            raise IndexError(f"there is no object after the last of {len(self._objects)}")
        self._current += 1

    def reset(self) -> None:
        """Bring the first object."""
        self._current = 0
