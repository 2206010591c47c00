"""The exploration poses: rotations that turn different sides of the object to the pad.

A pose is applied after the object's unknown orientation. The six poses of the ``mix`` set are views along faces, edges
and a corner of a cube in the object's frame. Quaternions are ``wxyz``; the pad faces +x.

To add a pose, add one entry to :data:`POSES`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Quaternion = NDArray[np.float64]


def multiply(left: Quaternion, right: Quaternion) -> Quaternion:
    """The rotation ``right`` followed by ``left`` (Hamilton product, ``wxyz``)."""
    return np.array(hamilton_product(left, right))


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
    return np.array(matrix_rows(quaternion))


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
