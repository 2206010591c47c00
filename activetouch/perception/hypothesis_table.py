"""Hypotheses of a scene's objects, embedded by a reader: the table that the joint observation model works with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activetouch.hypotheses import sizes
from activetouch.perception.reader import TactileReader
from activetouch.poses import to_matrices, turned
from activetouch.scene import Scene


@dataclass(frozen=True, eq=False)
class HypothesisTable:
    """Embeds as many hypotheses as asked for, in every pose of a scene.

    Attributes:
        reader: embeds them.
        scene: says which orientations and sizes there are, and how poses turn an object.
    """

    reader: TactileReader
    scene: Scene

    def __call__(self, num_hypotheses: int) -> NDArray[np.float32]:
        """Embedded hypotheses ``(P, K, N, D)``, N of each shape, the same orientations and sizes for all shapes."""
        rests, factors = self.hypotheses(num_hypotheses)
        num_shapes = len(self.scene.shapes)
        shapes, all_sizes = np.repeat(np.arange(num_shapes), num_hypotheses), np.tile(factors, num_shapes)
        table = []
        for pose in self.scene.poses.values():
            rotations = np.tile(to_matrices(turned(pose, rests)), (num_shapes, 1, 1))
            table.append(self.reader.embed(shapes, rotations, all_sizes).reshape(num_shapes, num_hypotheses, -1))
        return np.stack(table)

    def hypotheses(self, num_hypotheses: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Orientations at rest, unit quaternions ``wxyz`` ``(N, 4)``, and sizes ``(N,)``."""
        rests = self.scene.presentation.rests(num_hypotheses)
        return rests, sizes(self.scene.variation.size, num_hypotheses)
