"""Readers for sessions: of images that others recorded, and of the places of touches."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch.perception.reader import TactileReader
from activetouch.poses import require_reach
from activetouch.pressing.contact import missed
from activetouch.rendering import read_out
from activetouch.scene import Scene
from belief.errors import InvalidArgument
from belief.observation_model.model import ArrayModel
from belief.observation_model.rigid_body import joint_model
from belief.problem import Elsewhere, Touch
from belief.validation import are_finite, as_real, unmasked

if TYPE_CHECKING:
    from activetouch.pose_belief import PoseBelief
    from activetouch.recorded.reader import RecordedReader

_BLANKS, _USUAL = 100, 0.98  # images of no contact, and the share of them that is taken for one
_FAINT = 8.0  # of 255: a taxel that differs by less feels nothing, even without noise
_SAME = 1e-6  # rad, or parts of half a pad
_KEYS = {"quaternion", "aim"}


@dataclass(frozen=True, eq=False)
class SensorReader:
    """Reads images for sessions of a sensor of a scene (:class:`planners.session_log.ImageReader`)."""

    scene: Scene
    reader: TactileReader
    model: ArrayModel
    touches: Callable[[NDArray[np.uint8], Sequence[int]], list[Touch]]

    @cached_property
    def identity(self) -> str:
        """Digest of all that it reads with."""
        reader = self.reader
        return hashlib.sha256(f"{reader.digest} {reader.card.fields()}".encode()).hexdigest()

    @property
    def usual(self) -> dict[str, tuple[float, float, str]]:
        """Least and largest force and area of contacts in the scene, and the unit of each."""
        face = (2.0 * self.scene.pad.half_width) ** 2
        return {"force": (*self.scene.variation.force.support, "N"), "area": (0.0, face, "m²")}

    def read(self, image: ArrayLike, pose: int) -> tuple[NDArray[np.uint8], Touch, float]:
        """The image as bytes, the touch that it shows, and the area of the contact [m²]; see :func:`checked_image`."""
        checked = checked_image(image, self.scene.image_shape)
        return checked, self.touches(checked[None], [pose])[0], self.area(checked)

    def pose(self, evidence: Any, shape: int, poses: Sequence[int], images: Sequence[NDArray[np.uint8]]) -> PoseBelief:
        """How an object of a shape lies; see :func:`activetouch.perception.pose_search.pose_of`."""
        from activetouch.perception.pose_search import pose_of  # only those who ask need it

        return pose_of(self.scene, evidence, shape, poses, images)

    def area(self, image: NDArray[np.uint8]) -> float:
        """Area of the taxels that read more than without contact [m²]; 0 for an image like 98 of 100 of no contact.

        A weak contact that only the sum of all taxels shows counts as one taxel.
        """
        nothing, limit, limit_of_sum = self._blank
        if (hand := self.scene.hand) is not None:
            image = np.concatenate(hand.apart(image[None])[0], axis=2)[0]
        differs = np.abs(image - nothing)
        of_taxels = differs if differs.ndim == 2 else differs.max(axis=2)
        number = int((of_taxels > limit).sum())
        number = max(number, int(differs.sum() > limit_of_sum))
        return number * (2.0 * self.scene.pad.half_width) ** 2 / image.shape[0] ** 2

    def at(self, place: Mapping[str, Any]) -> tuple[int, Elsewhere | None]:
        """The pose of a place; if it is none of the poses, the nearest one, and the hypotheses embedded there.

        ``place`` has a ``quaternion`` (w, x, y, z), the turn of the object, and an ``aim``, the position of its centre
        from the approach axis along y and z [m]; or ``place``, the six numbers together.
        """
        quaternion, aim = _numbers_of(place)
        scene = self.scene
        turns = np.abs(np.stack([*scene.rotations.values()]) @ quaternion)
        angles = 2.0 * np.arccos(np.minimum(turns, 1.0))
        away = np.linalg.norm(scene.aim_offsets - aim, axis=1) / scene.pad.half_width
        nearest = int(np.argmin(angles + away))
        require_reach("the aim of a place", aim, scene.reach + float(np.linalg.norm(scene.aim_offsets, axis=1).max()))
        if np.abs(turns[nearest] - 1.0) < _SAME**2 and away[nearest] < _SAME:
            return nearest, None
        model, hypotheses, card = joint_model(self.model), self.reader.hypotheses, self.reader.card
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
        """The mean image of no contact, and how much a taxel, and the sum, differ from it in 2 of 100 such images."""
        scene, rng = self.scene, np.random.default_rng(0)
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

    reader: RecordedReader
    touches: Callable[[NDArray[np.float64], Sequence[int]], list[Touch]]

    @cached_property
    def identity(self) -> str:
        """Digest of all that it reads with."""
        from activetouch.recorded.reader_file import digest_of  # which sensors of scenes do not need

        return digest_of(self.reader)

    def read(self, image: ArrayLike, pose: int) -> tuple[NDArray[np.float64], Touch, float | None]:
        """The row ``(F,)`` as numbers, the touch that it shows, and 0 if it could be one of no contact, else None."""
        size = self.reader.num_features
        try:
            row = np.asarray(as_real(image, "image"), np.float64)
        except ValueError as error:  # also of lists of different lengths
            raise InvalidArgument(f"image must be a row of {size} features of the recordings: {error}") from error
        if row.shape != (size,):
            raise InvalidArgument(f"image must be a row of {size} features of the recordings, got {row.shape}")
        touch = self.touches(row[None], [pose])[0]
        return row, touch, 0.0 if self.reader.is_blank(row) else None

    def at(self, place: Mapping[str, Any]) -> tuple[int, None]:
        """Raise InvalidArgument: actions of recordings are no places."""
        raise InvalidArgument(
            f"this sensor knows the actions {self.reader.action_names} and no places, got {place!r:.80}"
        )


def checked_image(image: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """An image of whole numbers from 0 to 255 as bytes.

    >>> checked_image([[0, 255]], (1, 2)).dtype
    dtype('uint8')
    """
    wanted = f"an image must be {shape} whole numbers from 0 to 255"
    try:
        given = unmasked(image, "it")
    except (ValueError, OverflowError) as error:  # also of lists of different lengths
        raise InvalidArgument(f"{wanted}: {error}") from error
    if given.shape != shape or given.dtype.kind not in "uif":
        raise InvalidArgument(f"{wanted}, got {given.dtype} {given.shape}")
    if not ((given >= 0) & (given <= 255) & (given == np.floor(given))).all():
        raise InvalidArgument(f"{wanted}; it holds others")
    return given.astype(np.uint8)


def _numbers_of(place: Mapping[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit quaternion and aim of a place."""
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
