"""Hypotheses about an object, whatever its shape."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.hypotheses import member_shares, sizes
from activetouch.scene import Scene


class Bodies(NamedTuple):
    """N hypotheses about an object, whatever its shape.

    Attributes:
        rests: orientations at rest, unit quaternions ``wxyz``, ``(N, 4)``.
        sizes: relative to the nominal size, ``(N,)``.
        shares: where they are in a family of solids (:func:`activetouch.hypotheses.member_shares`), ``(N,)``.
    """

    rests: NDArray[np.float64]
    sizes: NDArray[np.float64]
    shares: NDArray[np.float64]

    def take(self, some: slice | NDArray[np.int64]) -> Bodies:
        """Some of the hypotheses."""
        return Bodies(*(part[some] for part in self))


def bodies_of(scene: Scene, num_hypotheses: int) -> Bodies:
    """Hypotheses that cover the orientations and sizes of a scene's objects evenly, the same for all shapes.

    Args:
        scene: of the objects.
        num_hypotheses: N.
    """
    rests = scene.presentation.rests(num_hypotheses)
    return Bodies(rests, sizes(scene.variation.size, num_hypotheses), member_shares(num_hypotheses))
