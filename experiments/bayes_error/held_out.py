"""Held-out touches to measure on: each of another object, from a generator keyed by its number.

Errors of touches of one object are correlated. With one touch per object the touches are independent, and the number of
correct ones is binomial.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.pressing.contact import Contact
from activetouch.rendering import read_out
from activetouch.rendering.faults import split_at_noise
from activetouch.scene import Scene
from belief.seeding import keyed_rng

Floats = NDArray[np.float64]


class Stream(IntEnum):
    """Purpose of a touch; the same number in two streams is two different objects.

    A recorded collection keys its generators by (seed, split 0 to 2, number). These start at 3, so that no classifier
    was trained on these objects, even with the same seed.
    """

    TEST = 3
    KNOWN = 4
    CHOICE = 5
    BANK = 6
    BODY = 7
    TOUCHED = 8
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
