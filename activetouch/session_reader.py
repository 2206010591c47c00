"""What a sensor reads for a session: images that somebody else recorded, and where touches were made."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch.pressing.contact import missed
from activetouch.recorded.reader_file import digest_of
from activetouch.rendering import read_out
from activetouch.sensor import RecordedSensor, TactileSensor
from belief.errors import InvalidArgument
from belief.observation_model.rigid_body import joint_model
from belief.problem import Elsewhere, Touch
from belief.validation import are_finite

_BLANKS, _USUAL = 100, 0.98  # images of no contact, and the share of them that is taken for one
_FAINT = 8.0  # of 255: a taxel that differs by less feels nothing, even without noise
_SAME = 1e-6  # rad, or parts of half a pad
_KEYS = {"quaternion", "aim"}


@dataclass(frozen=True, eq=False)
class SensorReader:
    """Reads images for sessions of a sensor of a scene (:class:`planners.session_log.ImageReader`)."""

    sensor: TactileSensor

    @cached_property
    def identity(self) -> str:
        """Digest of all that it reads with."""
        reader = self.sensor.reader
        return hashlib.sha256(f"{reader.digest} {reader.card.fields()}".encode()).hexdigest()

    def read(self, image: ArrayLike, pose: int) -> tuple[NDArray[np.uint8], Touch, float]:
        """The checked image, the touch that it shows, and the area of the contact [m²].

        Args:
            image: whole numbers from 0 to 255, of the shape of the scene's images.
            pose: index of the pose.

        Raises:
            InvalidArgument: it is no such image.
        """
        checked = checked_image(image, self.sensor.scene.image_shape)
        return checked, self.sensor.read(checked[None], [pose])[0], self.area(checked)

    def area(self, image: NDArray[np.uint8]) -> float:
        """Area of the taxels that read more than they do without contact [m²].

        It is 0 where the image could be one of no contact: 98 of 100 of these are. A weak contact that only the sum of
        all taxels tells counts as one taxel.
        """
        nothing, limit, limit_of_sum = self._blank
        if (hand := self.sensor.scene.hand) is not None:
            image = np.concatenate(hand.apart(image[None])[0], axis=2)[0]
        differs = np.abs(image - nothing)
        of_taxels = differs if differs.ndim == 2 else differs.max(axis=2)
        number = int((of_taxels > limit).sum())
        number = max(number, int(differs.sum() > limit_of_sum))
        return number * (2.0 * self.sensor.scene.pad.half_width) ** 2 / image.shape[0] ** 2

    def at(self, place: Mapping[str, Any]) -> tuple[int, Elsewhere | None]:
        """The pose of a place; if it is none of the poses, the nearest one, and the hypotheses embedded there.

        Args:
            place: ``quaternion`` (w, x, y, z), by which the object was turned, and ``aim``, where its centre was, from
                the approach axis along y and z [m]; or ``place``, the six numbers together.

        Raises:
            InvalidArgument: it is no place, or the sensor knows no touches elsewhere than in its poses.
        """
        quaternion, aim = _numbers_of(place)
        scene = self.sensor.scene
        turns = np.abs(np.stack([*scene.rotations.values()]) @ quaternion)
        angles = 2.0 * np.arccos(np.minimum(turns, 1.0))
        away = np.linalg.norm(scene.aim_offsets - aim, axis=1) / scene.pad.half_width
        nearest = int(np.argmin(angles + away))
        if np.abs(turns[nearest] - 1.0) < _SAME**2 and away[nearest] < _SAME:
            return nearest, None
        model, hypotheses, card = joint_model(self.sensor.model), self.sensor.reader.hypotheses, self.sensor.reader.card
        if model is None or hypotheses is None or not (card.imaging is not None or not away.min()):
            raise InvalidArgument(
                "only a sensor whose belief is about one rigid body takes touches that are in none of its poses "
                f"{scene.pose_labels}, and only a reader of predicted contacts takes other aims; the "
                f"nearest is {scene.pose_labels[nearest]!r}, {np.degrees(angles[nearest]):.1f}° and "
                f"{1e3 * np.linalg.norm(scene.aim_offsets[nearest] - aim):.2f} mm away"
            )
        there = scene.with_pose(quaternion, aim)
        embedded = hypotheses.embedded(there, scene.hypotheses(model.num_hypotheses), len(scene.poses))
        return nearest, Elsewhere((*quaternion.tolist(), *aim.tolist()), embedded)

    @cached_property
    def _blank(self) -> tuple[NDArray[np.float64], float, float]:
        """The mean image of no contact; how much a taxel, and all together, differ from it in 2 of 100 such images."""
        scene, rng = self.sensor.scene, np.random.default_rng(0)
        ideal, number = scene.image(missed(scene.pad)), 1 if scene.hand is None else len(scene.hand)
        readings = [read_out(ideal, scene.faults, rng) for _ in range(_BLANKS * number)]
        images = np.stack([np.hstack(readings[i::_BLANKS]) for i in range(_BLANKS)]).astype(np.float64)
        nothing = images.mean(axis=0)
        differs = np.abs(images - nothing).reshape(_BLANKS, -1)
        limit = max(_FAINT, float(np.quantile(differs.max(axis=1), _USUAL)))
        return nothing, limit, max(_FAINT, float(np.quantile(differs.sum(axis=1), _USUAL)))


@dataclass(frozen=True, eq=False)
class RecordedRowReader:
    """Reads rows of features for sessions of a sensor of recorded touches."""

    sensor: RecordedSensor

    @cached_property
    def identity(self) -> str:
        """Digest of all that it reads with."""
        return digest_of(self.sensor.recorded_reader)

    def read(self, image: ArrayLike, pose: int) -> tuple[NDArray[np.float64], Touch, None]:
        """The row of features ``(F,)`` as numbers, and the touch that it shows; see :meth:`RecordedSensor.read`."""
        row, size = np.asarray(image, np.float64), self.sensor.recorded_reader.num_features
        if row.shape != (size,):
            raise InvalidArgument(f"image must be a row of {size} features of the recordings, got {row.shape}")
        return row, self.sensor.read(row[None], [pose])[0], None

    def at(self, place: Mapping[str, Any]) -> tuple[int, None]:
        """Refused: actions of recordings are no places."""
        raise InvalidArgument(
            f"this sensor knows the actions {self.sensor.pose_labels} and no places, got {place!r:.80}"
        )


def session_reader(sensor: TactileSensor) -> SensorReader | RecordedRowReader:
    """What reads the images of a sensor."""
    return RecordedRowReader(sensor) if isinstance(sensor, RecordedSensor) else SensorReader(sensor)


def checked_image(image: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """An image as bytes.

    Args:
        image: whole numbers from 0 to 255.
        shape: that it must have.

    Raises:
        InvalidArgument: it has another shape, or holds something else.

    >>> checked_image([[0, 255]], (1, 2)).dtype
    dtype('uint8')
    """
    wanted = f"an image must be {shape} whole numbers from 0 to 255"
    try:
        given = np.asarray(image)
    except (ValueError, OverflowError) as error:  # lists of different lengths
        raise InvalidArgument(f"{wanted}: {error}") from error
    if given.shape != shape or given.dtype.kind not in "uif":
        raise InvalidArgument(f"{wanted}, got {given.dtype} {given.shape}")
    if not ((given >= 0) & (given <= 255) & (given == np.floor(given))).all():
        raise InvalidArgument(f"{wanted}; it holds others")
    return given.astype(np.uint8)


def _numbers_of(place: Mapping[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit quaternion and aim."""
    if set(place) not in ({"place"}, {"quaternion"}, _KEYS):
        raise InvalidArgument(f"a place has a quaternion, and an aim where it is not 0; got {sorted(map(str, place))}")
    parts = [place[name] for name in ("place", "quaternion", "aim") if name in place]
    given = [number for part in parts if isinstance(part, Sequence | np.ndarray) for number in part]
    given += [0.0, 0.0] * (set(place) == {"quaternion"})
    is_numbers = all(isinstance(number, int | float | np.number) and are_finite(number) for number in given)
    if not is_numbers or len(given) != 6:
        raise InvalidArgument(f"a place must be a quaternion (w, x, y, z) and an aim (y, z), got {parts!r:.80}")
    numbers = np.array(given, np.float64)
    norm = float(np.linalg.norm(numbers[:4]))
    if abs(norm - 1.0) > 1e-3:
        raise InvalidArgument(f"the quaternion of a place must have the norm 1, got {norm:g}")
    return numbers[:4] / norm, numbers[4:]
