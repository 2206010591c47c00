"""Held-out touches to measure on: each of another object, from a generator keyed by its number.

Errors of touches of one object are correlated. With one touch per object the touches are independent, and the number of
correct ones is binomial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.pressing.contact import Contact
from activetouch.rendering import Fault, Noise, read_out
from activetouch.scene import Scene
from activetouch.sensor import TactileSensor
from belief.observation_model.selection import log_posteriors
from belief.seeding import keyed_rng
from belief.statistics import wilson_interval
from benchmarks.bayes_error.findings import chunks
from experiments.parallel import run_tasks
from experiments.sensor.scores import read_images

Floats = NDArray[np.float64]


class Stream(IntEnum):
    """Purpose of a touch; the same number in two streams is two different objects.

    A recorded collection keys its generators by (seed, split 0 to 2, number). These start at 3, so that no classifier
    was trained on these objects, even with the same seed.
    """

    TEST = 3
    KNOWN = 4
    CHOICE = 5
    BODY = 7
    ORDER = 9


@dataclass(frozen=True, eq=False)
class HeldOutTouch:
    """One touch and all of its intermediate results.

    Attributes:
        shape: of the object, its index.
        pose: index of the pose that it was touched in.
        placement: pose of the object relative to the pad.
        contact: physics of the press.
        clean: the image just before noise is added, amplified; may exceed 1.
        reading: the sensor's image, uint8.
    """

    shape: int
    pose: int
    placement: Placement
    contact: Contact
    clean: Floats
    reading: NDArray[np.uint8]


def held_out_touch(scene: Scene, seed: int, stream: Stream, number: int) -> HeldOutTouch:
    """Touch the object of that number once, as ``scene.press`` does, and keep the intermediate results.

    Args:
        scene: the world.
        seed: of the generator.
        stream: purpose of the touch.
        number: of the object; shapes and poses alternate with it.

    Raises:
        UnstablePress: no press of the object settled.
    """
    rng = keyed_rng([seed, stream, number], is_fixed_length=True)
    shape, pose = number % len(scene.shapes), number // len(scene.shapes) % len(scene.poses)
    pressed = replace(scene, faults=()).press(scene.sample_object(shape, rng), pose, rng)
    clean: NDArray[Any] = pressed.ideal
    before, after = split_at_noise(scene.faults)
    for fault in before:
        clean = fault(clean, rng)
    return HeldOutTouch(shape, pose, pressed.placement, pressed.contact, clean, read_out(clean, after, rng))


def held_out_readings(scene: Scene, seed: int, stream: Stream, numbers: range) -> tuple[int, NDArray[np.uint8]]:
    """The first number, and the sensor's images of these touches, ``(n, H, W)`` or ``(n, H, W, 3)``."""
    return numbers[0], np.stack([held_out_touch(scene, seed, stream, number).reading for number in numbers])


def split_at_noise(faults: Sequence[Fault]) -> tuple[Sequence[Fault], Sequence[Fault]]:
    """The faults before the first :class:`Noise`, and the rest, which is empty without noise."""
    first = next((n for n, fault in enumerate(faults) if isinstance(fault, Noise)), len(faults))
    return faults[:first], faults[first:]


@dataclass(frozen=True, eq=False)
class LimitStudy:
    """A sensor in its scene, and the number of touches to measure.

    Attributes:
        sensor: with the classifier that is compared with the limit.
        touches: number of held-out touches, each of another object.
        seed: of all randomness.
        jobs: processes; the results do not depend on it.
    """

    sensor: TactileSensor
    touches: int
    seed: int
    jobs: int

    @property
    def scene(self) -> Scene:
        """The world of the touches."""
        return self.sensor.scene

    @property
    def shapes(self) -> NDArray[np.int64]:
        """True shapes of the test touches, ``(N,)``."""
        return np.arange(self.touches) % len(self.scene.shapes)

    def read(self) -> NDArray[np.uint8]:
        """Readings of the test touches, ``(N, H, W)`` or ``(N, H, W, 3)``."""
        tasks = [
            partial(held_out_readings, self.scene, self.seed, Stream.TEST, numbers)
            for numbers in chunks(self.touches, 50)
        ]
        parts = sorted(run_tasks(tasks, self.jobs, "touching held-out objects"), key=lambda part: part[0])
        return np.concatenate([readings for _, readings in parts])

    def classify(self, readings: NDArray[np.uint8]) -> Floats:
        """Calibrated log probabilities of the classifier, ``(N, K)``."""
        poses = np.arange(self.touches) // len(self.scene.shapes) % len(self.scene.poses)  # as in held_out_touch
        touches = read_images(self.sensor.reader, readings, poses, "reading with the classifier")
        return log_posteriors(self.sensor.model, touches.reshaped((-1, 1)))


def share(right: NDArray[np.bool_]) -> dict[str, Any]:
    """A proportion of independent touches, with its 95 % Wilson interval."""
    return {"value": float(right.mean()), "interval": wilson_interval(int(right.sum()), len(right))}
