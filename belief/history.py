"""An immutable sequence of the touches of one object, oldest first."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from belief.problem import Touch


class TouchHistory(tuple[Touch, ...]):
    """The touches of one object, oldest first.

    >>> first = TouchHistory([Touch(0, np.zeros(2))])
    >>> longer = first.extended([Touch(2, np.zeros(2)), Touch(2, np.zeros(2))])
    >>> len(first), len(longer), longer.uses(num_poses=3).tolist()
    (1, 3, [1, 0, 2])
    """

    __slots__ = ()

    def extended(self, touches: Iterable[Touch]) -> TouchHistory:
        """This history followed by these touches."""
        return TouchHistory((*self, *touches))

    def uses(self, num_poses: int) -> NDArray[np.int64]:
        """Number of touches in each pose, ``(P,)``.

        Raises:
            ValueError: a touch has a pose that is out of range.
        """
        poses = np.array([touch.pose for touch in self], np.int64)
        if poses.size and poses.max() >= num_poses:
            raise ValueError(f"a touch was made in pose {poses.max()}, there are {num_poses} poses")
        return np.bincount(poses, minlength=num_poses)
