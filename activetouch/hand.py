"""Hands: pads in known rotations about the palm, which close on one body and make one grasp.

A grasp of m fingers is m presses of one body. A pose of the scene turns the body in the palm's frame; each finger
closes along its own axis until its force. The body's position in the palm and the force are drawn once a grasp; every
pad has faults of its own. The image of a grasp shows those of its fingers side by side.

    >>> from activetouch import SCENES
    >>> scene = SCENES["coarse"].scene.with_hand("parallel")
    >>> rng = np.random.default_rng(0)
    >>> grasp = scene.press(scene.sample_object("cone", rng), "front", rng)
    >>> grasp.image.shape, len(grasp.contacts)
    ((4, 8), 2)
    >>> bool(np.linalg.norm(scene.hand.net_force([contact.force for contact in grasp.contacts])) < 1e-9)
    True
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from activetouch.distributions import Distribution, Uniform, quantiles
from activetouch.poses import Placement, Quaternion, multiply, require_unit, to_matrix, turn
from belief.constraints import Within, check
from belief.errors import InvalidArgument, UnknownName
from belief.frozen import frozen
from belief.naming import few
from belief.validation import require_count

_UNBALANCED = 0.02  # largest net force, relative to the sum of all forces
_SAME_PLACE = 1e-3  # rad
_OPEN = 0.08  # distance of an open finger from the middle of the palm [m]
_INVERSE = (1.0, -1.0, -1.0, -1.0)
_MOST_ALONG = 3  # places along each axis

PalmOffset = Literal["averaged", "anew", "kept"]
Quaternions = tuple[tuple[float, float, float, float], ...]
_ALLEGRO: Quaternions = (  # index, middle, ring finger and thumb, in the frame of the palm
    (-0.4836, 0.6335, -0.6021, 0.0463),
    (0.7964, -0.0862, 0.5871, 0.1169),
    (0.5660, 0.4477, 0.6110, 0.3255),
    (-0.0894, 0.5844, 0.0395, 0.8055),
)


@dataclass(frozen=True)
class Hand:
    """The pads of a hand.

    Attributes:
        fingers: rotations that bring the pad of a scene without a hand to each finger's place about the palm, m unit
            quaternions ``wxyz``. Several fingers press with forces that balance each other, 1 on average.
        offset: treatment of the body's position in the palm by the belief. ``averaged``: the reader averages over it,
            for each finger alone. ``anew``: it is latent, common to the fingers of a grasp. In both cases every grasp
            draws it anew. ``kept``: it is latent, drawn once for each object, and turns with it.
        travel: standard deviation of the measured position of each finger where it stops [m]; None if it is not
            measured.

    >>> Hand.three_finger().forces.round(6).tolist()
    [1.0, 1.0, 1.0]
    >>> Hand((turn("z", 0.0), turn("z", 2.4), turn("z", -2.4))).forces.round(2).tolist()      # a thumb and two fingers
    [1.27, 0.86, 0.86]
    """

    fingers: Quaternions
    offset: PalmOffset = "averaged"
    travel: Annotated[float, Within(1e-5, _OPEN)] | None = None

    def __post_init__(self) -> None:
        check(self)
        given = list(self.fingers) if isinstance(self.fingers, Sequence | np.ndarray) else []
        if not given or isinstance(self.fingers, str):
            raise InvalidArgument(f"a hand needs one rotation for each finger, got {self.fingers!r:.80}")
        for number, finger in enumerate(given):
            if np.shape(finger) != (4,):
                raise InvalidArgument(f"finger {number} must be a unit quaternion (w, x, y, z), got {finger!r:.80}")
            require_unit(f"the rotation of finger {number}", finger)
        object.__setattr__(self, "fingers", tuple(tuple(map(float, finger)) for finger in given))
        for (one, left), (other, right) in combinations(enumerate(self.fingers), 2):
            if abs(np.dot(left, right)) > np.cos(_SAME_PLACE / 2):
                raise InvalidArgument(f"fingers {one} and {other} of the hand are in one place")
        if len(self) > 1 and np.linalg.norm(self.net_force(self.forces)) > _UNBALANCED * self.forces.sum():
            raise InvalidArgument(
                f"the {len(self)} fingers press from sides where no forces balance, so they hold no body; put one on "
                "the other side (turn('z', np.pi) opposes the first finger), or use Hand.parallel()"
            )

    def __len__(self) -> int:
        return len(self.fingers)

    @classmethod
    def one_finger(cls) -> Hand:
        """A single pad: a grasp is a quasistatic press."""
        return cls.around(1)

    @classmethod
    def parallel(cls) -> Hand:
        """Two opposed pads."""
        return cls.around(2)

    @classmethod
    def three_finger(cls) -> Hand:
        """Three pads, 120° apart."""
        return cls.around(3)

    @classmethod
    def allegro_fingertips(cls) -> Hand:
        """Pads on the four fingertips of an Allegro hand that closes (:mod:`activetouch.pressing.allegro`)."""
        return cls(_ALLEGRO)

    @classmethod
    def around(cls, number: int) -> Hand:
        """Pads evenly about the palm's z axis, at most 1000."""
        require_count("the number of fingers", number, most=1000)
        return cls(tuple(tuple(turn("z", 2 * np.pi * finger / number)) for finger in range(number)))

    @cached_property
    def forces(self) -> NDArray[np.float64]:
        """Force of each finger relative to that of a press, ``(m,)``, read-only.

        The net force is least, and the forces are as equal as that allows.
        """
        if len(self) == 1:
            return frozen(np.ones(1))
        rows = np.vstack([self.axes.T, 1e-4 * np.eye(len(self))])
        found = scipy.optimize.nnls(rows, np.append(np.zeros(3), np.full(len(self), 1e-4)))[0]
        return frozen(np.round(found / found.mean(), 9))

    @cached_property
    def rotations(self) -> NDArray[np.float64]:
        """The rotations of the fingers as matrices, ``(m, 3, 3)``, read-only."""
        return frozen(np.stack([to_matrix(np.array(finger)) for finger in self.fingers]))

    @property
    def axes(self) -> NDArray[np.float64]:
        """Directions in which the fingers press, in the palm's frame, ``(m, 3)``."""
        return self.rotations[:, :, 0]

    def net_force(self, forces: ArrayLike) -> NDArray[np.float64]:
        """The sum in the palm's frame, ``(3,)`` [N], of the fingers' forces ``(m,)`` [N]: what the palm has to hold."""
        return np.asarray(np.asarray(forces, float) @ self.axes)

    def across(self, place: ArrayLike) -> NDArray[np.float64]:
        """The components of a place in the palm, ``(3,)`` [m], along each finger's y and z axes, ``(m, 2)`` [m]."""
        return np.stack([(rotation.T @ np.asarray(place, float))[1:] for rotation in self.rotations])

    def places(self, offset: Distribution, reach: float) -> NDArray[np.float64]:
        """Equally probable positions of a body in the palm that stand for its distribution, ``(O, 3)`` [m].

        Along each axis there are at most three, as many as a reader needs that averages over ``reach`` [m] each way.
        Positions that no finger can tell apart are merged, unless the body keeps its place when it turns.

        >>> from activetouch.distributions import Uniform
        >>> Hand.parallel().places(Uniform(-0.006, 0.006), 0.002).shape
        (9, 3)
        """
        low, high = offset.support
        number = int(np.ceil((high - low) / (2 * reach) - 1e-6)) if reach > 0.0 else _MOST_ALONG
        number = min(max(number, 1), _MOST_ALONG)
        shares = (np.arange(number) + 0.5) / number
        along = low + (high - low) * shares if isinstance(offset, Uniform) else quantiles(offset, shares)
        grid = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
        if self.offset == "kept":
            return grid
        seen = np.round(np.stack([self.across(place).ravel() for place in grid]), 9)
        return np.asarray(grid[np.unique(seen, axis=0, return_index=True)[1]])

    def placements(self, in_palm: Placement, depth: float) -> list[Placement]:
        """The body in front of each finger.

        ``in_palm`` is the body in front of a finger that is not turned, at ``depth`` along the palm's x axis [m].
        """
        turned = [multiply(np.array(finger) * _INVERSE, in_palm.orientation) for finger in self.fingers]
        across = self.across((depth, *in_palm.offset))
        return [replace(in_palm, orientation=q, offset=place) for q, place in zip(turned, across, strict=True)]

    def joined(self, images: Sequence[NDArray[np.uint8]], stops: ArrayLike) -> NDArray[np.uint8]:
        """The image of a grasp: images of the fingers side by side, ``(H, m · W)`` or ``(H, m · W, 3)``.

        Where the hand reads travel, each has one more column, which is brighter the farther the finger travelled.
        ``stops (m,)`` are the distances from the middle of the palm at which the fingers stop [m].
        """
        if self.travel is None:
            return np.concatenate(images, axis=1)
        bright = np.round(255 * np.clip(1.0 - np.asarray(stops) / _OPEN, 0.0, 1.0)).astype(np.uint8)
        each = zip(images, bright, strict=True)
        return np.hstack([part for image, one in each for part in (image, np.full_like(image[:, :1], one))])

    def apart(self, images: NDArray[np.uint8]) -> tuple[list[NDArray[np.uint8]], NDArray[np.float64]]:
        """The inverse of :meth:`joined` for N grasps: each finger's images, and stops, ``(N, m)`` or ``(N, 0)`` [m]."""
        more = 0 if self.travel is None else 1
        if images.shape[2] != len(self) * (images.shape[1] + more):
            column = ", each with a column of its travel" if more else ""
            raise ValueError(f"images of {len(self)} fingers must be side by side{column}, got {images.shape[1:]}")
        parts = np.split(images, len(self), axis=2)
        bright = np.stack([part[:, :1, -1:].reshape(len(part), -1)[:, 0] for part in parts], axis=1)[
            :, : more * len(self)
        ]
        return [part[:, :, : images.shape[1]] for part in parts], _OPEN * (1.0 - bright / 255)

    def single(
        self, poses: Mapping[str, Quaternion], aims: Mapping[str, tuple[float, float]]
    ) -> list[tuple[dict[str, Quaternion], dict[str, tuple[float, float]]]]:
        """For each finger, the poses and aims that show a single pad what the finger meets in a pose of the palm."""
        turned = [{k: multiply(np.array(f) * _INVERSE, q) for k, q in poses.items()} for f in self.fingers]
        moved = {label: self.across((0.0, *aim)) for label, aim in aims.items()}
        return [(q, {k: (float(at[f, 0]), float(at[f, 1])) for k, at in moved.items()}) for f, q in enumerate(turned)]


HANDS: Mapping[str, Callable[[], Hand]] = MappingProxyType(
    {
        "one_finger": Hand.one_finger,
        "parallel": Hand.parallel,
        "three_finger": Hand.three_finger,
        "allegro": Hand.allegro_fingertips,
    }
)
"""Hands by name."""


def hand_named(hand: Hand | str) -> Hand:
    """The hand itself, or the one of a name."""
    if isinstance(hand, str):
        if hand not in HANDS:
            raise UnknownName("hand", hand, list(HANDS))
        return HANDS[hand]()
    if not isinstance(hand, Hand):
        raise InvalidArgument(f"hand must be a Hand or one of {few(list(HANDS))}, got {hand!r:.80}")
    return hand
