"""The world a search touches: real presses, read by the trained classifier.

    sensor = TactileSensor.shipped("gel")                       # scene, classifier and observation model
    world = TouchWorld.sample(sensor, arrangement=(2, 0, 3, 1), rng=np.random.default_rng(0))
    touch = world.touch(pose=0, rng=np.random.default_rng(1))

Many worlds are touched at once with :meth:`TactileSensor.touch_many`: presses one after the other, then one pass of the
network over all images. It also keeps the time each part took.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import LabelMismatch
from activetouch.rendering import read_out
from activetouch.scene import Scene, WorldObject
from activetouch.scenes import SCENES
from belief import Touch
from belief.errors import CorruptFile, UnknownName
from belief.observation_model import ArrayModel, read_observation_model

if TYPE_CHECKING:
    from activetouch.classifier import TouchClassifier

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
        CorruptFile: it is damaged, or missing.
    """
    path = folder / OBSERVATION_FILE
    try:
        return read_observation_model(path.read_text())
    except (OSError, ValueError) as error:
        raise CorruptFile(f"{path} is no observation model: {error}") from error


@dataclass(frozen=True, eq=False)
class TactileSensor:
    """A scene with the classifier trained for it and the observation model fitted to both.

    Attributes:
        scene: where presses come from.
        classifier: reads their images.
        model: turns what it reads into evidence.
        time: seconds spent so far.

    Raises:
        LabelMismatch: classifier or observation model were made for other shapes or poses.
    """

    scene: Scene
    classifier: TouchClassifier
    model: ArrayModel
    time: TouchTime = field(default_factory=TouchTime)

    def __post_init__(self) -> None:
        shapes, poses = self.scene.shape_labels, self.scene.pose_labels
        self.classifier.require_labels(shapes, poses)
        if self.model.shape_labels != shapes or self.model.num_poses != len(poses):
            raise LabelMismatch(
                f"the observation model is about the shapes {list(self.model.shape_labels)} in "
                f"{self.model.num_poses} poses, the scene has {list(shapes)} in {len(poses)}. Fit one "
                "for this scene: activetouch calibrate"
            )

    @classmethod
    def load(cls, folder: Path, scene: Scene) -> TactileSensor:
        """The sensor whose classifier and observation model lie in a folder.

        Raises:
            CorruptFile: one of the files is damaged.
            LabelMismatch: they were made for other shapes or poses than the scene's.
        """
        from activetouch.classifier import TouchClassifier  # loads torch

        model = load_observation_model(folder)
        return cls(scene, TouchClassifier.load(folder / CLASSIFIER_FILE), model)

    @classmethod
    def shipped(cls, name: str = "gel", scene: Scene | None = None) -> TactileSensor:
        """A sensor that comes with the package, by name, on the scene of that name or on another."""
        known = sorted(folder.name for folder in MODELS.iterdir() if folder.is_dir())
        if name not in known:
            raise UnknownName("sensor", name, known)
        return cls.load(MODELS / name, scene if scene is not None else SCENES[name].scene)

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
        return read_out(scene.renderer(contact), scene.faults, rng)

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
