"""Sources of an environment's touches: presses in MuJoCo, or samples from an observation model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.sensor import TactileSensor
from activetouch.world import TouchWorld
from belief.naming import Name
from belief.observation_model.model import ArrayModel
from belief.problem import Touch
from belief.synthetic import SyntheticWorld


class EpisodeWorld(Protocol):
    """The objects of one episode, one in front of the pad; it may have ``last_image``, ``(H, W[, 3])`` uint8."""

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
    """A :class:`activetouch.TouchWorld` that keeps the image of its last press."""

    last_image: NDArray[np.uint8] | None = None

    def touch(self, pose: Name, rng: np.random.Generator) -> Touch:
        self.last_image, _ = self.press(pose, rng)
        return self._sensor.read(self.last_image[None], [pose])[0]


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
