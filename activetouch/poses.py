"""The exploration poses, which turn different sides of the object to the pad; objects, and where they lie.

A pose is applied after the object's unknown orientation. The six poses of the ``mix`` set are views along faces, edges
and a corner of a cube in the object's frame; the set ``directions26`` has all of its faces, edges and corners. In a
scene, a pose may also aim beside the approach axis (:func:`aimed`). Quaternions are ``wxyz``; the pad faces +x.

To add a pose, add one entry to :data:`POSES`; to add a set of poses, one to :data:`POSE_SETS`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import isfinite
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.solids.solid import Shape
from belief.errors import InvalidArgument, UnknownName

Quaternion = NDArray[np.float64]

_FARTHEST = 0.5  # aim [m]: largest objects have a radius of 0.3 m
_UNIT_SLACK = 1e-3  # error of a norm, for numbers that were rounded to three digits


def multiply(left: Quaternion, right: Quaternion) -> Quaternion:
    """The rotation ``right`` followed by ``left`` (Hamilton product, ``wxyz``)."""
    return np.array(hamilton_product(_components(left), _components(right)))


def hamilton_product(left: Iterable[Any], right: Iterable[Any]) -> list[Any]:
    """The four components of a product of quaternions ``wxyz``, from theirs: numbers, arrays or tensors."""
    (w1, x1, y1, z1), (w2, x2, y2, z2) = left, right
    return [
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
    ]


def to_matrix(quaternion: Quaternion) -> NDArray[np.float64]:
    """Rotation matrix ``(3, 3)`` of a unit quaternion ``wxyz``: its columns are the rotated axes."""
    return np.array(matrix_rows(_components(quaternion)))


def _components(quaternions: Quaternion) -> Iterable[Any]:
    """The components ``wxyz``; of a single quaternion as Python's numbers, whose arithmetic is faster than numpy's."""
    found = np.asarray(quaternions, float)
    return found.tolist() if found.ndim == 1 else found


def matrix_rows(quaternion: Iterable[Any]) -> list[list[Any]]:
    """The rows of a rotation matrix, from the components ``wxyz`` of its quaternion: numbers, arrays or tensors."""
    w, x, y, z = quaternion
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def to_matrices(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices ``(N, 3, 3)`` of unit quaternions ``wxyz``, ``(N, 4)``."""
    return np.moveaxis(to_matrix(quaternions.T), 2, 0)


def turned(pose: Quaternion, orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Orientations ``(N, 4)`` after a pose has turned the objects."""
    return multiply(pose, orientations.T).T


def random_orientation(rng: np.random.Generator) -> Quaternion:
    """A uniformly distributed unit quaternion (Haar measure on SO(3))."""
    quaternion = rng.normal(size=4)
    return quaternion / np.linalg.norm(quaternion)


def normalised(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors ``(n, d)`` of length 1, in the same directions."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def slightly_turned(orientations: Quaternion, widths: Any, rng: np.random.Generator) -> Quaternion:
    """Orientations ``(n, 4)`` after small random turns, of half a width [rad] about each axis; one or ``(n,)``."""
    small = rng.normal(size=(3, len(orientations))) * (widths / 2)
    return normalised(np.stack(hamilton_product(orientations.T, (np.ones(len(orientations)), *small)), axis=1))


def require_unit(what: str, quaternion: Sequence[float] | Quaternion) -> None:
    """Check that four numbers are a unit quaternion; others would stretch objects."""
    if len(quaternion) != 4 or not abs(math.hypot(*quaternion) - 1.0) <= _UNIT_SLACK:
        raise InvalidArgument(
            f"{what} must be a unit quaternion (w, x, y, z), got {np.asarray(quaternion).tolist()}; divide it by its "
            "norm, or make it with activetouch.poses.turn"
        )


def turn(axis: str, angle: float) -> Quaternion:
    """The rotation by ``angle`` [rad] about the axis ``"x"``, ``"y"`` or ``"z"``."""
    quaternion = np.zeros(4)
    quaternion[0], quaternion[1 + "xyz".index(axis)] = np.cos(angle / 2), np.sin(angle / 2)
    return quaternion


POSES: Mapping[str, Quaternion] = MappingProxyType(
    {
        "front": turn("z", np.deg2rad(0.0)),
        "z45": turn("z", np.deg2rad(45.0)),
        "z90": turn("z", np.deg2rad(90.0)),
        "y45": turn("y", np.deg2rad(45.0)),
        "y90": turn("y", np.deg2rad(90.0)),
        "corner": multiply(turn("y", np.arctan(np.sqrt(0.5))), turn("z", np.deg2rad(45.0))),
    }
)
"""The six ``mix`` poses by name; their order is the pose index and the paper's POSE_0 … POSE_5."""


def facing(direction: Sequence[float]) -> Quaternion:
    """The smallest rotation that turns a side of the object to the pad, which the object meets with its side -x.

    >>> to_matrix(facing((0.0, 1.0, 0.0))).dot([0.0, 1.0, 0.0]).round(3).tolist()
    [-1.0, 0.0, 0.0]
    """
    x, y, z = np.asarray(direction, float) / np.linalg.norm(direction)
    if x > 1.0 - 1e-12:
        return turn("z", np.pi)
    quaternion = np.array([1.0 - x, 0.0, -z, y])  # half way between -x and the direction
    return quaternion / np.linalg.norm(quaternion)


def _directions26() -> Mapping[str, Quaternion]:
    """Faces, then corners, then edges of a cube."""
    found = {}
    for num_axes in (1, 3, 2):
        for signs in (s for s in product((-1, 0, 1), repeat=3) if np.count_nonzero(s) == num_axes):
            name = "".join("-+"[sign > 0] + axis for sign, axis in zip(signs, "xyz", strict=True) if sign)
            found[name] = facing(signs)
    return MappingProxyType(found)


POSE_SETS: Mapping[str, Mapping[str, Quaternion]] = MappingProxyType({"mix": POSES, "directions26": _directions26()})
"""Sets of poses by name. A pose of ``directions26`` is named for the side that meets the pad: ``-x``, ``+x-y+z``."""


def aimed(
    poses: Mapping[str, Quaternion], offsets: Sequence[tuple[float, float]]
) -> tuple[dict[str, Quaternion], dict[str, tuple[float, float]]]:
    """Every pose with every lateral offset: the ``poses`` and the ``aims`` of a scene.

    Args:
        offsets: of the object's centre from the approach axis, along y and along z [m].

    >>> poses, aims = aimed(POSES, [(0.0, 0.0), (0.005, 0.0)])
    >>> len(poses), list(aims.items())[:2]
    (12, [('front (+0,+0) mm', (0.0, 0.0)), ('front (+5,+0) mm', (0.005, 0.0))])
    """
    places = {f"{pose} ({y * 1e3:+.3g},{z * 1e3:+.3g}) mm": (pose, (y, z)) for pose in poses for y, z in offsets}
    return {label: poses[pose] for label, (pose, _) in places.items()}, {name: aim for name, (_, aim) in places.items()}


def checked_aims(
    given: Mapping[str, tuple[float, float]], poses: Mapping[str, Quaternion]
) -> dict[str, tuple[float, float]]:
    """The aims that differ from zero, in the order of the poses."""
    for label, aim in given.items():
        if label not in poses:
            raise UnknownName("pose", label, list(poses))
        if np.shape(aim) != (2,) or not np.isfinite(aim).all():
            raise InvalidArgument(f"the aim of the pose {label!r} must be two finite numbers [m], got {aim!r}")
        require_reach(f"the aim of the pose {label!r}", aim, _FARTHEST)
    return {label: (float(given[label][0]), float(given[label][1])) for label in poses if any(given.get(label, ()))}


def require_reach(what: str, aim: Sequence[float] | NDArray[np.float64], reach: float) -> None:
    """Check that an aim is not farther from the approach axis than anything is felt, both [m]."""
    if math.hypot(*aim) > reach:
        y, z = (f"{number:g}" for number in aim)
        raise InvalidArgument(
            f"{what} must be at most {reach:.3g} m from the approach axis, got [{y}, {z}] m, where nothing is felt: is "
            "it in mm?"
        )


@dataclass(frozen=True, eq=False)
class WorldObject:
    """One physical object, as it is for a whole episode.

    Attributes:
        shape_index: index of its shape.
        scale: its size factor.
        orientation: orientation in which it was put on its guide, ``wxyz``.
        friction: friction coefficient of its surface.
        stiffness: stiffness of its skin together with the pad's layer, relative to the layer's alone.
        member: its solid at nominal size, where its shape is a family; None for any other shape, and for the nominal
            solid of a family.
        offset: displacement of its centre from its place, or from the middle of the palm, before a pose turns it,
            ``(3,)`` [m], if a hand keeps it or it has moved.
    """

    shape_index: int
    scale: float
    orientation: Quaternion
    friction: float = 1.0
    stiffness: float = 1.0
    member: Shape | None = None
    offset: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class Placement:
    """An object in front of the pad, ready to be pressed.

    ``orientation`` is a unit quaternion ``wxyz`` from the object's frame to the pad's; ``offset (2,)`` is the position
    of its centre from the approach axis, along y and z [m]; ``friction`` is the coefficient of sliding friction on the
    pad; ``stiffness`` is that of the pad's layer and the object's skin together, relative to the pad's alone.
    """

    shape: Shape
    scale: float
    orientation: Quaternion
    offset: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    friction: float = 1.0
    stiffness: float = 1.0

    def __post_init__(self) -> None:
        numbers = (self.scale, self.friction, self.stiffness, *self.offset, *self.orientation)
        if not (all(map(isfinite, numbers)) and min(self.scale, self.stiffness) > 0.0 and self.friction >= 0.0):
            raise ValueError(
                f"scale and stiffness must be above zero, friction at least zero, all finite; got {self}, friction "
                f"{self.friction}, stiffness {self.stiffness}"
            )
        require_unit("orientation", self.orientation)

    @property
    def bounding_radius(self) -> float:
        """Radius of the smallest ball about its centre that contains it [m]."""
        return self.shape.bounding_radius * self.scale

    def __str__(self) -> str:
        return (
            f"{self.shape} at scale {self.scale:.3g} in orientation {np.round(self.orientation, 4).tolist()}, "
            f"offset {np.asarray(self.offset).tolist()} m"
        )
