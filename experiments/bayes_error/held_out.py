"""Touches for measurements: every one of another object, from a generator keyed by its number.

Touches of one object err together. Where an interval is wanted, as many objects as touches are the simplest cure: the
touches are then independent, and a proportion of them is binomial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from activetouch.placement import Placement
from activetouch.pressing.contact import Contact
from activetouch.rendering import Fault, Noise, read_out
from activetouch.scene import Scene
from belief.seeding import keyed_rng

Floats = NDArray[np.float64]


class Stream(IntEnum):
    """What touches are for; the same number in two streams is two objects.

    A recorded collection keys its generators by (seed, split 0 to 2, number), so these start at 3: even with its seed
    no classifier was trained on these objects.
    """

    TEST = 3
    KNOWN = 4
    CHOICE = 5
    BANK = 6


@dataclass(frozen=True, eq=False)
class FreshTouch:
    """One touch, with everything that led to it.

    Attributes:
        shape: of the object, its index.
        pose: it was touched in.
        placement: of the object before the pad.
        contact: physics of the press.
        clean: the image just before noise is added, amplified; may exceed 1.
        reading: what the sensor gave, uint8.
    """

    shape: int
    pose: int
    placement: Placement
    contact: Contact
    clean: Floats
    reading: NDArray[np.uint8]


def fresh_touch(scene: Scene, seed: int, stream: Stream, number: int) -> FreshTouch:
    """Touch the object of that number, once: what ``scene.press`` gives, and what it does not tell.

    Shapes take turns, and so do the poses.

    Raises:
        UnstablePress: no press of it settled.
    """
    rng = keyed_rng([seed, stream, number], is_fixed_length=True)
    shape, pose = number % len(scene.shapes), number // len(scene.shapes) % len(scene.poses)
    placement, contact, _ = scene.settled_contact(scene.sample_object(shape, rng), pose, rng)
    clean = scene.image(contact)
    before, after = split_at_noise(scene.faults)
    for fault in before:
        clean = fault(clean, rng)
    return FreshTouch(shape, pose, placement, contact, clean, read_out(clean, after, rng))


def split_at_noise(faults: Sequence[Fault]) -> tuple[Sequence[Fault], Sequence[Fault]]:
    """The faults before the first :class:`~activetouch.rendering.Noise`, and the others; all of them without any."""
    first = next((n for n, fault in enumerate(faults) if isinstance(fault, Noise)), len(faults))
    return faults[:first], faults[first:]


def fresh_readings(scene: Scene, seed: int, stream: Stream, numbers: range) -> tuple[int, NDArray[np.uint8]]:
    """First number, and the sensor's images of the touches of these numbers, ``(n, H, W)`` or ``(n, H, W, 3)``."""
    return numbers[0], np.stack([fresh_touch(scene, seed, stream, number).reading for number in numbers])
