"""Hypotheses of a scene's objects, embedded by a reader: the table that the joint observation model works with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Distribution
from activetouch.hypotheses import sizes, stiffnesses
from activetouch.perception.reader import TactileReader
from activetouch.poses import to_matrices, turned
from activetouch.randomisation import assumed
from activetouch.scene import Scene


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


@dataclass(frozen=True, eq=False)
class HypothesisTable:
    """Embeds as many hypotheses as asked for, in every pose of a scene.

    Attributes:
        reader: embeds them.
        scene: says which orientations and sizes there are, and how poses turn an object.
        stiffness: distribution of the stiffness where it was measured. Otherwise a reader that knows stiffness allows
            for other ones than the scene's (:func:`activetouch.randomisation.assumed`).
    """

    reader: TactileReader
    scene: Scene
    stiffness: Distribution | None = None

    def __call__(self, num_hypotheses: int) -> NDArray[np.float32]:
        """Embedded hypotheses ``(P, K, N, D)``, N of each shape, the same orientations and sizes for all shapes."""
        bodies = self.hypotheses(num_hypotheses)
        num_shapes = len(self.scene.shapes)
        shapes = np.repeat(np.arange(num_shapes), num_hypotheses)
        numbers = (np.tile(bodies.sizes, num_shapes), np.tile(bodies.stiffnesses, num_shapes))
        table = []
        for pose in self.scene.poses.values():
            rotations = np.tile(to_matrices(turned(pose, bodies.rests)), (num_shapes, 1, 1))
            table.append(self.reader.embed(shapes, rotations, *numbers).reshape(num_shapes, num_hypotheses, -1))
        return np.stack(table)

    def hypotheses(self, num_hypotheses: int) -> Bodies:
        """The hypotheses, the same for all shapes."""
        vary = self.scene.variation
        if self.reader.card.knows_stiffness:
            vary = assumed(vary, self.stiffness)
        rests = self.scene.presentation.rests(num_hypotheses)
        return Bodies(rests, sizes(vary.size, num_hypotheses), stiffnesses(vary.stiffness, num_hypotheses))
