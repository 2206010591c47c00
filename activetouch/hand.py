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
from itertools import combinations
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from activetouch.errors import WrongScene
from activetouch.poses import Quaternion, multiply, require_unit, to_matrix, turn
from belief.errors import InvalidArgument, UnknownName
from belief.naming import few

if TYPE_CHECKING:
    from activetouch.placement import Placement

_UNBALANCED = 0.02  # of the forces of all fingers together
_SAME_PLACE = 1e-3  # rad

Quaternions = tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True)
class Hand:
    """The pads of a hand.

    Attributes:
        fingers: rotations that bring the pad of a scene without a hand to each finger's place about the palm, m unit
            quaternions ``wxyz``. Several fingers press with forces that balance each other, 1 on average.

    Raises:
        InvalidArgument: there is no finger, a rotation is no unit quaternion, two fingers are in one place, or no
            forces of several fingers balance each other.

    >>> Hand.three_finger().forces.round(6).tolist()
    [1.0, 1.0, 1.0]
    >>> Hand((turn("z", 0.0), turn("z", 2.4), turn("z", -2.4))).forces.round(2).tolist()      # a thumb and two fingers
    [1.27, 0.86, 0.86]
    """

    fingers: Quaternions

    def __post_init__(self) -> None:
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
    def around(cls, number: int) -> Hand:
        """Pads evenly about the palm's z axis."""
        return cls(tuple(tuple(turn("z", 2 * np.pi * finger / number)) for finger in range(number)))

    @property
    def forces(self) -> NDArray[np.float64]:
        """Force of each finger, relative to that of a press, ``(m,)``: such that the sum of their vectors is least."""
        if len(self) == 1:
            return np.ones(1)
        rows = np.vstack([self.axes.T, np.full(len(self), 1e-3)])  # the last sets the scale, and spreads the forces
        found = scipy.optimize.nnls(rows, np.array([0.0, 0.0, 0.0, 1.0]))[0]
        return np.round(found / found.mean(), 9)

    @property
    def axes(self) -> NDArray[np.float64]:
        """Directions in which the fingers press, in the palm's frame, ``(m, 3)``."""
        return np.stack([to_matrix(np.array(finger))[:, 0] for finger in self.fingers])

    def net_force(self, forces: ArrayLike) -> NDArray[np.float64]:
        """The sum of the fingers' forces in the palm's frame, ``(3,)`` [N]: that which the palm has to hold.

        Args:
            forces: of the fingers, ``(m,)`` [N]; 0 for a finger that misses.
        """
        return np.asarray(np.asarray(forces, float) @ self.axes)

    def placements(self, in_palm: Placement, depth: float) -> list[Placement]:
        """What each finger meets of a body in the palm.

        Args:
            in_palm: the body, in front of a finger that is not turned.
            depth: of the body's centre along the palm's x axis [m].
        """
        found = []
        for finger in self.fingers:
            back = np.array(finger) * (1.0, -1.0, -1.0, -1.0)
            offset = (to_matrix(back) @ (depth, *in_palm.offset))[1:]
            found.append(replace(in_palm, orientation=multiply(back, in_palm.orientation), offset=offset))
        return found

    def single(
        self, poses: Mapping[str, Quaternion], aims: Mapping[str, tuple[float, float]]
    ) -> list[tuple[dict[str, Quaternion], dict[str, tuple[float, float]]]]:
        """Of each finger, the poses and aims with which a single pad meets what the finger does.

        Args:
            poses: of the palm.
            aims: of the palm, see :class:`activetouch.Scene`.
        """
        found = []
        for finger in self.fingers:
            back = np.array(finger) * (1.0, -1.0, -1.0, -1.0)
            turned = {label: multiply(back, rotation) for label, rotation in poses.items()}
            moved = {label: to_matrix(back)[1:, 1:] @ aim for label, aim in aims.items()}
            found.append((turned, {label: (float(y), float(z)) for label, (y, z) in moved.items()}))
        return found


HANDS: Mapping[str, Callable[[], Hand]] = MappingProxyType(
    {"one_finger": Hand.one_finger, "parallel": Hand.parallel, "three_finger": Hand.three_finger}
)
"""Hands by name."""


def hand_named(hand: Hand | str) -> Hand:
    """The hand itself, or the one of a name.

    Raises:
        UnknownName: there is no hand of this name.
        InvalidArgument: it is neither.
    """
    if isinstance(hand, str):
        if hand not in HANDS:
            raise UnknownName("hand", hand, list(HANDS))
        return HANDS[hand]()
    if not isinstance(hand, Hand):
        raise InvalidArgument(f"hand must be a Hand or one of {few(list(HANDS))}, got {hand!r:.80}")
    return hand


def require_no_hand(hand: Hand | None, what: str) -> None:
    """Check that there is no hand.

    Raises:
        WrongScene: there is one.
    """
    if hand is not None:
        raise WrongScene(f"{what} takes single touches, and the scene has a hand of {len(hand)}; leave it out")
