"""Sources of an environment's touches: presses in MuJoCo, or samples from an observation model."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.scene import Scene, WorldObject
from activetouch.sensor import TactileSensor
from activetouch.world import TouchWorld
from belief import Touch
from belief.naming import Name
from belief.observation_model import ArrayModel
from belief.synthetic import SyntheticWorld


@dataclass(frozen=True, eq=False)
class RecordedPress:
    """The image of a press, and the arguments that repeat it.

    Attributes:
        image: the sensor's image, ``(H, W)`` or ``(H, W, 3)`` uint8.
        scene: where the press was made.
        thing: the object.
        pose: label or index of the pose.
        rng: state of the generator before the press.
    """

    image: NDArray[np.uint8]
    scene: Scene
    thing: WorldObject
    pose: Name
    rng: np.random.Generator


class EpisodeWorld(Protocol):
    """The objects of one episode, one of them in front of the pad.

    It may have an attribute ``last_press``, a :class:`RecordedPress`.
    """

    def touch(self, pose: int, rng: np.random.Generator) -> Touch:
        """Touch the current object."""

    def advance(self) -> None:
        """Replace the current object by the next one."""


class Touches(Protocol):
    """A source of touches."""

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """Names of the poses."""

    @property
    def model(self) -> ArrayModel:
        """The observation model of the touches."""

    def world(self, arrangement: Sequence[int], rng: np.random.Generator) -> EpisodeWorld:
        """New objects of these shapes, in order of visit."""


@dataclass(frozen=True, eq=False)
class LiveTouches:
    """Presses in MuJoCo, read by the network of ``sensor``."""

    sensor: TactileSensor

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """See :class:`Touches`."""
        return self.sensor.scene.pose_labels

    @property
    def model(self) -> ArrayModel:
        """See :class:`Touches`."""
        return self.sensor.model

    def world(self, arrangement: Sequence[int], rng: np.random.Generator) -> TouchWorld:
        """See :class:`Touches`; the objects of :meth:`activetouch.TouchWorld.sample`."""
        return _RecordingWorld.sample(self.sensor, arrangement, rng)


class _RecordingWorld(TouchWorld):
    """A :class:`activetouch.TouchWorld` that keeps its last press."""

    last_press: RecordedPress | None = None

    def touch(self, pose: Name, rng: np.random.Generator) -> Touch:
        before = deepcopy(rng)
        image, _ = self.press(pose, rng)
        self.last_press = RecordedPress(image, self._sensor.scene, self.current, pose, before)
        return self._sensor.read(image[None], [pose])[0]


@dataclass(frozen=True, eq=False)
class SampledTouches:
    """Touches drawn from an observation model: no physics, no network, and exactly calibrated beliefs.

    Attributes:
        model: the distribution of the touches.
        pose_labels: names of the poses.
    """

    model: ArrayModel
    pose_labels: tuple[str, ...]

    def world(self, arrangement: Sequence[int], rng: np.random.Generator) -> SyntheticWorld:
        """See :class:`Touches`."""
        return SyntheticWorld(self.model, arrangement)
