"""What a touch gives away without its image: shape guessed from force and depth alone.

A classifier that sees images should owe its accuracy to them. This baseline bounds what could leak through the two
numbers a press ends with: the majority among the nearest calibration touches in (force, depth).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from activetouch.dataset import TouchSet

Floats = NDArray[np.float64]


def depth_and_force_accuracy(known: TouchSet, test: TouchSet, num_neighbours: int = 51) -> float:
    """Share of test touches whose shape the nearest known touches in (force, depth) vote for.

    Args:
        known: touches whose shapes are told.
        test: touches of other objects.
        num_neighbours: touches that vote.
    """
    return neighbour_accuracy(_numbers(known), known.shapes, _numbers(test), test.shapes, num_neighbours)


def neighbour_accuracy(
    known: Floats, known_shapes: NDArray[np.int64], test: Floats, test_shapes: NDArray[np.int64], num_neighbours: int
) -> float:
    """Share of test rows whose shape the majority of the nearest known rows has, columns scaled alike.

    Args:
        known: numbers of touches whose shapes are told, ``(n, D)``.
        known_shapes: those shapes, ``(n,)``.
        test: numbers of other touches, ``(m, D)``.
        test_shapes: their shapes, ``(m,)``.
        num_neighbours: touches that vote.
    """
    scale = known.std(axis=0) + np.finfo(float).tiny
    _, nearest = KDTree(known / scale).query(test / scale, k=min(num_neighbours, len(known)))
    votes = np.eye(known_shapes.max() + 1)[known_shapes[nearest.reshape(len(test), -1)]].sum(axis=1)  # (m, K)
    return float(np.mean(votes.argmax(axis=1) == test_shapes))


def _numbers(touches: TouchSet) -> Floats:
    return np.column_stack([touches.forces, touches.depths])
