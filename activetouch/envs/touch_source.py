"""Where the objects and touches of an environment come from: priors of shapes, presses in MuJoCo, or a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from activetouch.sensor import TactileSensor
from activetouch.world import TouchWorld
from belief.observation_model.model import ArrayModel
from belief.problem import Touch
from belief.synthetic import SyntheticWorld
from belief.validation import Floats


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
        return TouchWorld.sample(self.sensor, arrangement, rng)


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


TargetProb: TypeAlias = float | tuple[float, float]
"""Prior probability of the target; or a range, from which every test draws its own, uniformly (decision 0031)."""


@dataclass(frozen=True)
class ObjectPriors:
    """Priors that give the target a probability in a range, and equal probabilities to the other K - 1 shapes."""

    num_shapes: int
    low: float
    high: float

    def __post_init__(self) -> None:
        if not (self.num_shapes > 1 and 0.0 < self.low <= self.high < 1.0):
            raise ValueError(
                f"a test needs at least two shapes, and target_prob must be a number or an increasing range in (0, 1); "
                f"got {self.num_shapes} shapes and {self.low}, {self.high}"
            )

    @classmethod
    def of(cls, num_shapes: int, target_prob: TargetProb) -> ObjectPriors:
        """The priors of a probability or a range."""
        ends = np.ravel(np.asarray(target_prob, np.float64)).tolist()
        if len(ends) not in (1, 2):
            raise ValueError(f"target_prob must be a probability or a range (low, high), got {target_prob}")
        return cls(num_shapes, ends[0], ends[-1])

    @property
    def middle(self) -> float:
        """Middle of the range."""
        return (self.low + self.high) / 2.0

    def draw(self, rng: np.random.Generator, number: int) -> Floats:
        """Prior probabilities of the target for ``number`` tests, ``(number,)``."""
        if self.low == self.high:
            return np.full(number, self.low)
        return rng.uniform(self.low, self.high, number)

    def probs(self, target_probs: ArrayLike, targets: ArrayLike) -> Floats:
        """Probabilities of all shapes, ``(..., K)``, from those of the targets, ``(...)``, and their indices."""
        target = np.asarray(target_probs, np.float64)[..., None]
        if not ((target > 0.0) & (target < 1.0)).all():
            raise ValueError(f"the target's probability must be in (0, 1), got {target_probs!r}")
        is_target = np.arange(self.num_shapes) == np.asarray(targets)[..., None]
        return np.where(is_target, target, (1.0 - target) / (self.num_shapes - 1))
