"""Where an environment's touches come from: live presses, or an observation model that stands in for them."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.scene import Scene, WorldObject
from activetouch.world import TactileSensor, TouchWorld
from belief import Touch
from belief.observation_model import ArrayModel
from belief.synthetic import SyntheticWorld


@dataclass(frozen=True, eq=False)
class RecordedPress:
    """The image of a press, and what it takes to repeat that press.

    Attributes:
        image: the sensor's image, ``(H, W)`` or ``(H, W, 3)`` uint8.
        scene: where the press was made.
        thing: the object.
        pose: index of the pose.
        rng: state of the generator before the press.
    """

    image: NDArray[np.uint8]
    scene: Scene
    thing: WorldObject
    pose: int
    rng: np.random.Generator


class Objects(Protocol):
    """The objects of one episode, the current one in front of the pad."""

    def touch(self, pose: int, rng: np.random.Generator) -> tuple[Touch, RecordedPress | None]:
        """Touch the current object; the press too, where there is one."""

    def advance(self) -> None:
        """Put the current object aside and bring the next."""


class Touches(Protocol):
    """Where touches come from."""

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """Names of the poses."""

    @property
    def model(self) -> ArrayModel:
        """What turns touches into evidence."""

    def objects(self, arrangement: Sequence[int], rng: np.random.Generator) -> Objects:
        """New objects of these shapes."""


@dataclass(frozen=True, eq=False)
class LiveTouches:
    """Presses in MuJoCo, read by the sensor's network.

    Attributes:
        sensor: scene, classifier and observation model.
    """

    sensor: TactileSensor

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """See :class:`Touches`."""
        return self.sensor.scene.pose_labels

    @property
    def model(self) -> ArrayModel:
        """See :class:`Touches`."""
        return self.sensor.model

    def objects(self, arrangement: Sequence[int], rng: np.random.Generator) -> LiveObjects:
        """See :class:`Touches`; the objects that :meth:`TouchWorld.sample` makes."""
        return LiveObjects(self.sensor, arrangement, rng)


class LiveObjects:
    """The objects of a :class:`activetouch.TouchWorld`, whose presses can be shown.

    Args:
        sensor: presses and reads.
        arrangement: shapes in order of visit.
        rng: of sizes and orientations.
    """

    def __init__(self, sensor: TactileSensor, arrangement: Sequence[int], rng: np.random.Generator) -> None:
        self._world = TouchWorld.sample(sensor, arrangement, rng)
        self._sensor = sensor

    def touch(self, pose: int, rng: np.random.Generator) -> tuple[Touch, RecordedPress]:
        """See :class:`Objects`."""
        before = deepcopy(rng)
        image, _ = self._world.press(pose, rng)
        press = RecordedPress(image, self._sensor.scene, self._world.current, pose, before)
        return self._sensor.read(image[None], [pose])[0], press

    def advance(self) -> None:
        """See :class:`Objects`."""
        self._world.advance()


@dataclass(frozen=True, eq=False)
class SampledTouches:
    """Touches drawn from an observation model: no physics, no network, and beliefs that are exactly right.

    Attributes:
        model: what touches are drawn from.
        pose_labels: names of the poses.
    """

    model: ArrayModel
    pose_labels: tuple[str, ...]

    def objects(self, arrangement: Sequence[int], rng: np.random.Generator) -> SampledObjects:
        """See :class:`Touches`."""
        return SampledObjects(self.model, arrangement)


class SampledObjects:
    """Objects that feel as the model says.

    Args:
        model: what touches are drawn from.
        arrangement: shapes in order of visit.
    """

    def __init__(self, model: ArrayModel, arrangement: Sequence[int]) -> None:
        self._world = SyntheticWorld(model, arrangement)

    def touch(self, pose: int, rng: np.random.Generator) -> tuple[Touch, None]:
        """See :class:`Objects`."""
        return self._world.touch(pose, rng), None

    def advance(self) -> None:
        """See :class:`Objects`."""
        self._world.advance()
