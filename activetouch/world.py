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
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import BadMesh, MeshWarning
from activetouch.pressing.contact import PressedObject
from activetouch.scene import Scene, WorldObject
from belief.errors import InvalidArgument
from belief.naming import UNLISTED, Name, few, one_line, shape_name
from belief.problem import SearchProblem, Touch
from belief.seeding import arrangement_rng, sample_arrangement

_FIRST_STRANGER, _STRANGERS = 60_000_000, 1_000_000  # numbers of random bodies


class Presses(Protocol):
    """Presses objects of a scene and reads what they feel like; see :class:`activetouch.TactileSensor`."""

    @property
    def scene(self) -> Scene:
        """Where the objects are pressed."""

    def read(self, images: NDArray[np.uint8], poses: Sequence[Name]) -> list[Touch]:
        """Touches from images ``(N, H, W)`` and the poses that they were felt in."""


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


class TouchWorld:
    """Objects on their guides, one at a time in front of the pad.

    Args:
        sensor: presses and reads.
        objects: in order of visit.

    Attributes:
        last: press of the current object; None before the first.
    """

    def __init__(self, sensor: Presses, objects: Sequence[WorldObject]) -> None:
        self._sensor = sensor
        self._objects = tuple(objects)
        self._current = 0
        self._moved: WorldObject | None = None  # the current object as it lies since its last touch
        self.last: PressedObject | None = None

    @classmethod
    def sample(cls, sensor: Presses, arrangement: Sequence[Name], rng: np.random.Generator) -> TouchWorld:
        """Objects of the given shapes, by label or index, with random sizes and orientations.

        For :data:`belief.naming.UNLISTED` it is one of a random body.

        Raises:
            UnknownName: the scene has no such shape.
            InvalidArgument: the arrangement is one name, or an index is out of range.
        """
        if isinstance(arrangement, str):
            raise InvalidArgument(f"the arrangement must be a list of shapes, such as [{arrangement!r}]; got a name")
        return cls(sensor, [_object_of(sensor.scene, shape, rng) for shape in arrangement])

    @classmethod
    def of_search(
        cls, sensor: Presses, problem: SearchProblem, seed: int | Sequence[int], target: Name | None = None
    ) -> TouchWorld:
        """The world of a search, which the seed determines; with at most one target, also that target."""
        rng = arrangement_rng(seed)
        return cls.sample(sensor, sample_arrangement(problem, rng, target), rng)

    def __repr__(self) -> str:
        labels = self._sensor.scene.shape_labels
        objects = few([shape_name(labels, obj.shape_index) for obj in self._objects], most=8)
        return one_line(TouchWorld, objects, f"object {self._current} in front of the pad")

    @property
    def arrangement(self) -> tuple[int, ...]:
        """True shape of every object, in order of visit, or UNLISTED; for scoring only."""
        return tuple(obj.shape_index for obj in self._objects)

    @property
    def current(self) -> WorldObject:
        """The object in front of the pad."""
        return self._moved or self._objects[self._current]

    @property
    def last_image(self) -> NDArray[np.uint8] | None:
        """Of the last press of the current object, ``(H, W)`` or ``(H, W, 3)``; None before the first."""
        return None if self.last is None else self.last.image

    def press(self, pose: Name, rng: np.random.Generator) -> tuple[NDArray[np.uint8], TouchTime]:
        """The image of the current object pressed in a pose, and the time of the press.

        In a scene whose objects move, it may have moved since its last touch, and a grasp may turn it.

        Args:
            pose: label or index of the pose.
            rng: generator for the move, the offset, the force and the sensor's faults.

        Raises:
            UnstablePress: none of :data:`activetouch.scene.MOST_ATTEMPTS` presses settled.
        """
        started = time.perf_counter()
        scene = self._sensor.scene
        if scene.moves is not None and scene.hand is None:
            self._moved = self.current if self._moved is None else scene.moves.after(self._moved, rng)
        pressed = scene.press(self.current, pose, rng)
        if scene.moves is not None and pressed.left is not None:
            self._moved = replace(self.current, orientation=pressed.left)
        self.last = pressed
        return pressed.image, TouchTime(time.perf_counter() - started, 0.0, pressed.num_unsettled)

    def touch(self, pose: Name, rng: np.random.Generator) -> Touch:
        """Press the current object and read the image. See :meth:`press`."""
        return self._sensor.read(self.press(pose, rng)[0][None], [pose])[0]

    def advance(self) -> None:
        """Put the current object aside and bring the next."""
        if self._current + 1 == len(self._objects):
            raise IndexError(f"there is no object after the last of {len(self._objects)}")
        self._current, self._moved, self.last = self._current + 1, None, None

    def reset(self) -> None:
        """Bring the first object."""
        self._current, self._moved, self.last = 0, None, None


def _object_of(scene: Scene, shape: Name, rng: np.random.Generator) -> WorldObject:
    """An object of a shape, or of a random body that no training and no background knows."""
    if shape != UNLISTED:
        return scene.sample_object(shape, rng)
    from activetouch.perception.contacts.bodies import random_body
    from activetouch.solids.mesh import Mesh

    while True:
        surface = random_body(int(_FIRST_STRANGER + rng.integers(_STRANGERS)))
        with suppress(BadMesh), warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)
            body = Mesh("a random body", surface.vertices.T, surface.faces.T)
            return replace(scene.sample_object(0, rng), shape_index=UNLISTED, member=body)


def touch_many(
    sensor: Presses, pending: Sequence[tuple[TouchWorld, int, np.random.Generator]]
) -> tuple[list[Touch], TouchTime]:
    """Press the current object of many worlds, then read all images in one pass of the network.

    Args:
        sensor: reads the images.
        pending: of each touch, world, pose, and generator for the offset, the force and the sensor's faults.

    Returns:
        The touches, in the order of ``pending``, and the time they took.

    Raises:
        UnstablePress: a press did not settle in any attempt.
    """
    pressed = [world.press(pose, rng) for world, pose, rng in pending]
    images, times = zip(*pressed, strict=True)
    started = time.perf_counter()
    touches = sensor.read(np.stack(images), [pose for _, pose, _ in pending])
    return touches, sum(times, TouchTime(network=time.perf_counter() - started))
