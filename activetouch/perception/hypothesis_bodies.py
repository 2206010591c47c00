"""Hypotheses about an object, whatever its shape."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.hypotheses import sizes, stiffnesses
from activetouch.scene import Scene, Variation


class Bodies(NamedTuple):
    """N hypotheses about an object, whatever its shape.

    Attributes:
        rests: orientations at rest, unit quaternions ``wxyz``, ``(N, 4)``.
        sizes: relative to the nominal size, ``(N,)``.
        stiffnesses: relative to the pad's, ``(N,)``.
    """

    rests: NDArray[np.float64]
    sizes: NDArray[np.float64]
    stiffnesses: NDArray[np.float64]

    def take(self, some: slice) -> Bodies:
        """Some of the hypotheses."""
        return Bodies(*(part[some] for part in self))


def bodies_of(scene: Scene, num_hypotheses: int, variation: Variation | None = None) -> Bodies:
    """Hypotheses that cover the orientations and sizes of a scene's objects evenly, the same for all shapes.

    Args:
        scene: of the objects.
        num_hypotheses: N.
        variation: what varies; that of the scene by default.
    """
    vary = scene.variation if variation is None else variation
    rests = scene.presentation.rests(num_hypotheses)
    return Bodies(rests, sizes(vary.size, num_hypotheses), stiffnesses(vary.stiffness, num_hypotheses))
