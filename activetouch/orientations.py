"""Presentations: distributions of the orientation in which objects meet the pad before a pose turns them.

A presentation says two things: the orientation an object is given when it is put on its guide, and the one it shows
when a pose is asked for. ``Tumbled`` is the default; ``Resampled`` is how the paper collected its data (paper §5.3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import GOLDEN, kronecker, quaternions
from activetouch.poses import Quaternion, WorldObject, multiply, random_orientation, turn
from belief.constraints import Checked, Probability, Within

_ANGLE = Within(0.0, np.pi, unit=" rad")


class Presentation(Protocol):
    """The distribution of orientations; ``isotropic`` if all rotations about the approach axis are equally probable."""

    isotropic: ClassVar[bool]

    def rest(self, rng: np.random.Generator) -> Quaternion:
        """Orientation of an object that is put on its guide, unit quaternion ``wxyz``."""

    def shown(self, rest: Quaternion, pose: Quaternion, rng: np.random.Generator) -> Quaternion:
        """Orientation of an object in a pose, as the pad meets it."""

    def rests(self, num: int) -> NDArray[np.float64]:
        """Orientations that cover the distribution of :meth:`rest` evenly, the same at every call, ``(num, 4)``."""


class LyingAnyhow:
    """A presentation that puts an object on its guide in a uniformly random orientation, from which poses turn it."""

    isotropic: ClassVar[bool] = True

    def rest(self, rng: np.random.Generator) -> Quaternion:
        """See :class:`Presentation`."""
        return random_orientation(rng)

    def shown(self, rest: Quaternion, pose: Quaternion, rng: np.random.Generator) -> Quaternion:
        """See :class:`Presentation`."""
        return multiply(pose, rest)

    def rests(self, num: int) -> NDArray[np.float64]:
        """See :class:`Presentation`."""
        return quaternions(num)


@dataclass(frozen=True)
class Tumbled(LyingAnyhow):
    """An unknown, uniformly random orientation that lasts for the whole episode; poses turn the object from there."""


@dataclass(frozen=True)
class Inexact(Checked, LyingAnyhow):
    """Tumbled, in poses that are not reached exactly: every touch turns the object by another small rotation.

    ``error`` is their standard deviation about each axis [rad]. A reader that was trained with cells of this size
    (``TrainingRecipe.cell``) expects such touches.
    """

    error: Annotated[float, _ANGLE] = np.deg2rad(5.6)

    def shown(self, rest: Quaternion, pose: Quaternion, rng: np.random.Generator) -> Quaternion:
        """See :class:`Presentation`."""
        return multiply(small_turn(self.error, rng), multiply(pose, rest))


@dataclass(frozen=True)
class Upright(Checked):
    """Standing on its base at any heading, uniformly tilted by up to ``tilt`` [rad] about a random horizontal axis."""

    isotropic: ClassVar[bool] = False

    tilt: Annotated[float, _ANGLE] = np.deg2rad(5.0)

    def rest(self, rng: np.random.Generator) -> Quaternion:
        """See :class:`Presentation`."""
        heading, towards, tilt = rng.uniform(0.0, (2 * np.pi, 2 * np.pi, self.tilt))
        sine = np.sin(tilt / 2)
        lean = np.array([np.cos(tilt / 2), sine * np.cos(towards), sine * np.sin(towards), 0.0])
        return multiply(lean, turn("z", heading))

    def shown(self, rest: Quaternion, pose: Quaternion, rng: np.random.Generator) -> Quaternion:
        """See :class:`Presentation`."""
        return multiply(pose, rest)

    def rests(self, num: int) -> NDArray[np.float64]:
        """See :class:`Presentation`."""
        rng = np.random.default_rng(0)
        return np.stack([self.rest(rng) for _ in range(num)])


@dataclass(frozen=True)
class Resampled(LyingAnyhow):
    """A new random orientation for every touch, whatever the pose: touches of one object are then independent."""

    def shown(self, rest: Quaternion, pose: Quaternion, rng: np.random.Generator) -> Quaternion:
        """See :class:`Presentation`."""
        return random_orientation(rng)


_FACING = (turn("z", 0.0), turn("z", np.pi), *(turn(axis, sign * np.pi / 2) for axis in "yz" for sign in (1.0, -1.0)))


@dataclass(frozen=True)
class Held(Checked):
    """As a closing hand holds it: an axis of the object points at the pad, and another one in every touch.

    A hand turns a box or a cylinder until a face or its side lies on the pad. The six directions are equally probable,
    and so are rotations about the approach axis. Poses turn the object from there, so that ``front`` alone shows sides.
    Touches are independent given shape and size.

    ``error`` is the standard deviation of the remaining turn about each axis [rad].
    """

    isotropic: ClassVar[bool] = True

    error: Annotated[float, _ANGLE] = np.deg2rad(10.0)

    def rest(self, rng: np.random.Generator) -> Quaternion:
        """See :class:`Presentation`."""
        return self._facing(int(rng.integers(len(_FACING))), rng.uniform(), rng)

    def shown(self, rest: Quaternion, pose: Quaternion, rng: np.random.Generator) -> Quaternion:
        """See :class:`Presentation`."""
        return multiply(pose, self.rest(rng))

    def rests(self, num: int) -> NDArray[np.float64]:
        """See :class:`Presentation`."""
        rng, rolls = np.random.default_rng(0), kronecker(GOLDEN, num)
        return np.stack([self._facing(number % len(_FACING), roll, rng) for number, roll in enumerate(rolls)])

    def _facing(self, side: int, roll: float, rng: np.random.Generator) -> Quaternion:
        """The orientation in which a side faces the pad, after a part of a whole turn about the approach axis."""
        return multiply(small_turn(self.error, rng), multiply(turn("x", 2.0 * np.pi * roll), _FACING[side]))


ANEW = Resampled, Held
"""Presentations in which an object lies anew in each touch."""


@dataclass(frozen=True)
class Moves(Checked):
    """How an object moves between two touches, as one that slips or rolls when it is pressed.

    Attributes:
        prob: probability of a move before each touch but the first.
        angle: standard deviation of the turn about each axis [rad].
        shift: the centre then lies up to so far from its place along each axis, in the object's frame [m].
    """

    prob: Probability = 0.2
    angle: Annotated[float, _ANGLE] = np.deg2rad(15.0)
    shift: Annotated[float, Within(0.0, 0.1, unit=" m")] = 0.005

    def after(self, obj: WorldObject, rng: np.random.Generator) -> WorldObject:
        """The object before its next touch: as it was, or turned and shifted.

        >>> always = Moves(prob=1.0, shift=0.0)
        >>> resting = WorldObject(0, 1.0, np.array([1.0, 0.0, 0.0, 0.0]))
        >>> always.after(resting, np.random.default_rng(0)).orientation.round(2).tolist()
        [1.0, -0.02, 0.08, 0.01]
        """
        if rng.random() >= self.prob:
            return obj
        turned = multiply(small_turn(self.angle, rng), obj.orientation)
        return replace(obj, orientation=turned, offset=rng.uniform(-self.shift, self.shift, 3))


def small_turn(error: float, rng: np.random.Generator) -> Quaternion:
    """A random rotation with a standard deviation about each axis [rad], unit quaternion ``wxyz``."""
    small = np.array([1.0, *rng.normal(0.0, error / 2, 3)])
    return small / np.linalg.norm(small)
