"""Images of the touches of a few episodes, so that deciders which make the same touch press the object once.

A touch depends only on its episode, object, pose and number of earlier touches in that pose (decision 0007). Images are
kept and not what the network reads in them, because its last bits depend on the other images of a pass (decision 0045).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from activetouch import TouchWorld
from activetouch.world import TouchTime
from planners.search import TouchRequest

MOST_BYTES = 1 << 28
"""Size of the images that a memo keeps at most; further ones are pressed each time."""


class TouchMemo:
    """The images of touches by episode, object, pose and repeat, in one setting.

    Args:
        most_bytes: of all images together.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._left = most_bytes
        self._kept: dict[tuple[int, ...], tuple[NDArray[np.uint8], TouchTime]] = {}
        self.num_shared = 0

    @property
    def num_kept(self) -> int:
        """Number of touches whose images are kept."""
        return len(self._kept)

    def press(self, request: TouchRequest[TouchWorld]) -> tuple[NDArray[np.uint8], TouchTime]:
        """The image of a touch, and the time that its press took when it was made.

        Args:
            request: a touch of the memo's setting.

        Raises:
            UnstablePress: see :meth:`activetouch.world.TouchWorld.press`.
        """
        if (kept := self._kept.get(request.key)) is not None:
            self.num_shared += 1
            return kept
        image, seconds = request.world.press(request.pose, request.rng)
        if image.nbytes <= self._left:
            self._left -= image.nbytes
            self._kept[request.key] = image, seconds
        return image, seconds
