"""The world a search touches: real presses, read by the trained network.

    sensor = TactileSensor.shipped("gel")                       # scene, reader and observation model
    world = TouchWorld.sample(sensor, arrangement=("cone", "cube"), rng=np.random.default_rng(0))
    touch = world.touch("front", rng=np.random.default_rng(1))

Many worlds are touched at once with :func:`touch_many`: presses one after the other, then one pass of the network over
all images.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import LogUniform
from activetouch.errors import LabelMismatch, NoIndependentModel, SceneShift
from activetouch.named_scenes import SCENES
from activetouch.perception.card import ClassifierCard, read_card
from activetouch.perception.felt_touch import FeltTouch
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.perception.reader import TactileReader
from activetouch.scene import Scene, WorldObject
from activetouch.scene_description import in_words, require_scene, scene_fields
from belief import Touch
from belief.errors import CorruptFile, UnknownName
from belief.files import write_text
from belief.naming import Name, few, index_of, one_line
from belief.observation_model import ArrayModel, read_observation_model, read_origin
from belief.observation_model.registry import JOINT_MODELS

MODELS = Path(__file__).parent / "models"
READER_FILE, OBSERVATION_FILE = "reader.safetensors", "observation_model.json"
INDEPENDENT_FILE = "independent_model.json"  # beside a joint model: takes touches as independent given the shape
INDEPENDENT_SUFFIX = "-independent"  # of a shipped sensor that takes touches as independent given the shape
ROBUST_SUFFIX = "-robust"  # of a shipped sensor whose reader was trained in a wider world than the scene
POLICIES = "policies"  # folder of trained policies beside the two


@dataclass(frozen=True)
class TouchTime:
    """Seconds that touches took, by part, and the presses that did not settle and were repeated."""

    physics: float = 0.0
    network: float = 0.0
    pressed_again: int = 0

    def __add__(self, other: TouchTime) -> TouchTime:
        return TouchTime(
            self.physics + other.physics, self.network + other.network, self.pressed_again + other.pressed_again
        )


class PendingTouch(Protocol):
    """A touch that an episode waits for."""

    @property
    def world(self) -> TouchWorld:
        """Whose current object to touch."""

    @property
    def pose(self) -> int:
        """In which pose."""

    @property
    def rng(self) -> np.random.Generator:
        """Generator of offset, force and sensor faults."""


def load_observation_model(folder: Path, independent: bool = False) -> ArrayModel:
    """The observation model of the sensor in a folder.

    Args:
        folder: of the sensor.
        independent: whether it must take touches as independent given the shape: see :func:`observation_file`.

    Raises:
        CorruptFile: it is damaged, was changed since, or is missing.
        NoIndependentModel: the sensor has no such model.
    """
    return fitted_model(folder, independent).model


def observation_file(folder: Path, independent: bool = False) -> Path:
    """The file of a sensor's observation model.

    Args:
        folder: of the sensor.
        independent: whether to prefer, beside a joint model, the one that takes touches as independent given the shape.
    """
    other = folder / INDEPENDENT_FILE
    return other if independent and other.exists() else folder / OBSERVATION_FILE


def write_observation_model(
    folder: Path,
    model: ArrayModel,
    scene: Mapping[str, Any],
    file: str = OBSERVATION_FILE,
    stiffness: tuple[float, float] | None = None,
) -> None:
    """Write the observation model of a sensor.

    Args:
        folder: of the sensor.
        model: the model.
        scene: fields of the scene that its touches come from (:func:`activetouch.scene_description.scene_fields`).
        file: name of the file; :data:`INDEPENDENT_FILE` for a second model beside a joint one.
        stiffness: range that hypotheses of a joint model are about, where it was measured.
    """
    origin = {"scene": scene, **({} if stiffness is None else {"stiffness": list(stiffness)})}
    write_text(folder / file, model.to_json(origin) + "\n")


def sensor_shift(folder: Path, scene: Scene, anyway: bool = False, independent: bool = False) -> tuple[str, ...]:
    """How a scene differs from the one that the sensor in a folder was made for, found without loading its network.

    Args:
        folder: of reader and observation model.
        scene: in which it is to be used.
        anyway: whether to use it whatever the differences are, as long as its network can read the images at all.
        independent: whether its model that takes touches as independent given the shape is to be used.

    Returns:
        The differences, in words: known shifts, and with ``anyway`` all others too; none for the sensor's own scene.

    Raises:
        CorruptFile: one of the files is damaged or missing.
        NoIndependentModel: the sensor has only a joint model.
        LabelMismatch: it was made for other shapes or poses than the scene's.
        WrongScene: it was made for a scene that differs by more than a known shift.
    """
    card = read_card(folder / READER_FILE)
    fitted = fitted_model(folder, independent)
    return _shift(folder, card, fitted.model, fitted.scene, scene, anyway)


class FittedModel(NamedTuple):
    """An observation model, and what its file says about the world that it was fitted to.

    Attributes:
        model: the model.
        scene: fields of the scene; None if the file has none.
        stiffness: its range where it was measured.
    """

    model: ArrayModel
    scene: Mapping[str, Any] | None
    stiffness: LogUniform | None


def fitted_model(folder: Path, independent: bool = False) -> FittedModel:
    """The observation model in a folder, and what it was fitted to.

    Args:
        folder: of the sensor.
        independent: see :func:`observation_file`.

    Raises:
        CorruptFile: it is damaged, was changed since, or is missing.
        NoIndependentModel: the sensor has only a joint model.
    """
    path = observation_file(folder, independent)
    try:
        text = path.read_text(encoding="utf-8")
        origin = read_origin(text) or {}
        scene, ends = origin.get("scene"), origin.get("stiffness")
        if not (scene is None or isinstance(scene, dict)):
            raise ValueError(f"its scene is {scene!r}")
        if not (
            ends is None or (isinstance(ends, list) and len(ends) == 2 and all(type(end) is float for end in ends))
        ):
            raise ValueError(f"its stiffness is {ends!r}, not two numbers")
        stiffness = None if ends is None else LogUniform(*ends)
        model = read_observation_model(text)
    except OSError as error:
        raise CorruptFile(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise CorruptFile(f"{path} is no observation model: {error}") from error
    if independent and model.name in JOINT_MODELS:
        raise NoIndependentModel(
            f"{folder} holds only the joint observation model {model.name!r}, and no {INDEPENDENT_FILE} beside it. "
            "The command calibrate writes both files"
        )
    return FittedModel(model, scene, stiffness)


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
    found = require_scene(f"the reader in {folder}", card.in_poses_of(here), here, anyway)
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
    """A scene with the reader trained for it and the observation model fitted to both.

    Attributes:
        scene: where presses come from.
        reader: reads their images.
        model: turns what it reads into evidence.
        shift: how the scene differs from the one that reader and model were made for, in words; empty where it is
            the same.

    Raises:
        LabelMismatch: reader or observation model were made for other shapes or poses.
    """

    scene: Scene
    reader: TactileReader
    model: ArrayModel
    shift: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.reader.card.require_labels(self.scene.shape_labels, self.scene.pose_labels)
        _require_model(self.model, self.scene)

    @classmethod
    def load(cls, folder: Path, scene: Scene, anyway: bool = False, independent: bool = False) -> TactileSensor:
        """The sensor whose reader and observation model lie in a folder.

        A scene that differs from theirs by another press, other faults, sizes, forces or orientations is a known shift:
        a warning and :attr:`shift` tell it.

        Args:
            folder: of the two.
            scene: in which to use it.
            anyway: whether to use it, without a warning, in a scene that it was not made for.
            independent: whether to use its model that takes touches as independent given the shape.

        Raises:
            CorruptFile: one of the files is damaged or missing.
            NoIndependentModel: the sensor has only a joint model.
            LabelMismatch: they were made for other shapes or poses than the scene's.
            WrongScene: they were made for a scene that differs by more than a known shift.
        """
        model, fitted_to, stiffness = fitted_model(folder, independent)
        reader = TactileReader.load(folder / READER_FILE)
        shift = _shift(folder, reader.card, model, fitted_to, scene, anyway)
        if shift and not anyway:
            warnings.warn(
                f"the sensor in {folder} is used outside the scene it was made for: {in_words(shift)}",
                SceneShift,
                stacklevel=2,
            )
        if reader.hypotheses is not None:
            model = model.with_hypotheses(HypothesisTable(reader, scene, stiffness))
        return cls(scene, reader, model, shift=shift)

    @classmethod
    def shipped(cls, name: str = "gel", scene: Scene | None = None, anyway: bool = False) -> TactileSensor:
        """A sensor that comes with the package, in the scene that it was made for or in another. See :meth:`load`.

        Args:
            name: of a scene, for the sensor whose belief is about one rigid body; followed by ``-robust``, for the one
                whose reader was trained in a wider world; or by ``-independent``, for the sensor that reads shapes only
                and takes touches as independent given the shape.
            scene: in which to use it.
            anyway: as in :meth:`load`.

        Raises:
            UnknownName: there is no such sensor.
        """
        known = sorted(folder.name for folder in MODELS.iterdir() if folder.is_dir())
        if name not in known:
            raise UnknownName("sensor", name, known)
        of_scene = name.removesuffix(INDEPENDENT_SUFFIX).removesuffix(ROBUST_SUFFIX)
        return cls.load(MODELS / name, scene if scene is not None else SCENES[of_scene].scene, anyway)

    def __repr__(self) -> str:
        name = self.reader.card.backbone
        return one_line(TactileSensor, few(self.scene.shape_labels), f"network {name}", type(self.model).__name__)

    def read(self, images: NDArray[np.uint8], poses: Sequence[Name]) -> list[Touch]:
        """Touches from images ``(N, H, W)`` and the poses they were felt in."""
        labels = self.scene.pose_labels
        indices = [index_of("pose", labels, pose) for pose in poses]
        if (hypotheses := self.reader.hypotheses) is not None:
            embeddings, _ = self.reader.run(images)
            return [FeltTouch(pose, row, hypotheses) for pose, row in zip(indices, embeddings, strict=True)]
        reading = self.reader.read(images)
        return [
            Touch(pose, row, feature)
            for pose, row, feature in zip(indices, reading.logits, reading.embeddings, strict=True)
        ]


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
    def sample(cls, sensor: TactileSensor, arrangement: Sequence[Name], rng: np.random.Generator) -> TouchWorld:
        """Objects of the given shapes, by label or index, with random sizes and orientations."""
        return cls(sensor, [sensor.scene.sample_object(shape, rng) for shape in arrangement])

    def __repr__(self) -> str:
        labels = self._sensor.scene.shape_labels
        objects = few([labels[thing.shape_index] for thing in self._objects], most=8)
        return one_line(TouchWorld, objects, f"object {self._current} in front of the pad")

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shape of every object, in order of visit; for scoring only."""
        return tuple(thing.shape_index for thing in self._objects)

    @property
    def current(self) -> WorldObject:
        """The object in front of the pad."""
        return self._objects[self._current]

    def press(self, pose: Name, rng: np.random.Generator) -> tuple[NDArray[np.uint8], TouchTime]:
        """The image of the current object pressed in a pose, and the time that took.

        Args:
            pose: label or index of the pose.
            rng: of offset, force and the sensor's faults.

        Raises:
            UnstablePress: none of :data:`activetouch.scene.MOST_ATTEMPTS` presses settled.
        """
        started = time.perf_counter()
        pressed = self._sensor.scene.press(self.current, pose, rng)
        return pressed.image, TouchTime(time.perf_counter() - started, 0.0, pressed.num_unsettled)

    def touch(self, pose: Name, rng: np.random.Generator) -> Touch:
        """Press the current object and read the image. See :meth:`press`."""
        return self._sensor.read(self.press(pose, rng)[0][None], [pose])[0]

    def advance(self) -> None:
        """Put the current object aside and bring the next."""
        if self._current + 1 == len(self._objects):
            raise IndexError(f"there is no object after the last of {len(self._objects)}")
        self._current += 1

    def reset(self) -> None:
        """Bring the first object."""
        self._current = 0


PendingT = TypeVar("PendingT", bound=PendingTouch)


def touch_many(
    sensor: TactileSensor,
    pending: Sequence[PendingT],
    press: Callable[[PendingT], tuple[NDArray[np.uint8], TouchTime]] | None = None,
) -> tuple[list[Touch], TouchTime]:
    """Press the current object of many worlds, then read all images in one pass of the network.

    Args:
        sensor: reads the images.
        pending: the touches to make.
        press: gives the image of one, and the time it took; by default its world is pressed.

    Returns:
        The touches, in the order of ``pending``, and the time they took.

    Raises:
        UnstablePress: a press did not settle in any attempt.
    """
    pressed = [touch.world.press(touch.pose, touch.rng) if press is None else press(touch) for touch in pending]
    images, times = zip(*pressed, strict=True)
    started = time.perf_counter()
    touches = sensor.read(np.stack(images), [touch.pose for touch in pending])
    return touches, sum(times, TouchTime(network=time.perf_counter() - started))
