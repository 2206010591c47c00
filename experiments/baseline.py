"""What a touch gives away without its image: shape guessed from force and depth alone.

A classifier that sees images should owe its accuracy to them. This baseline bounds what could leak through the two
numbers a press ends with: the majority among the nearest calibration touches in (force, depth).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from activetouch.dataset import TouchSet


def depth_and_force_accuracy(known: TouchSet, test: TouchSet, num_neighbours: int = 51) -> float:
    """Share of test touches whose shape the nearest known touches in (force, depth) vote for.

    Args:
        known: touches whose shapes are told.
        test: touches of other objects.
        num_neighbours: touches that vote.
    """
    scale = _numbers(known).std(axis=0) + np.finfo(float).tiny
    _, nearest = KDTree(_numbers(known) / scale).query(_numbers(test) / scale, k=min(num_neighbours, len(known.shapes)))
    votes = np.eye(known.shapes.max() + 1)[known.shapes[nearest.reshape(len(test.shapes), -1)]].sum(axis=1)  # (n, K)
    return float(np.mean(votes.argmax(axis=1) == test.shapes))


def _numbers(touches: TouchSet) -> NDArray[np.float64]:
    return np.column_stack([touches.forces, touches.depths])
