"""The shape of a touch by the majority of the touches with the nearest numbers, such as force and depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def neighbour_guesses(known: Floats, known_shapes: Integers, test: Floats, num_neighbours: int) -> Integers:
    """The shape that the majority of the nearest known rows has, columns scaled alike, for every test row.

    All rows as near as the last voter vote, too: presses that bottom out share one depth, and which of them a search
    comes upon first would decide.

    Args:
        known: numbers of touches with known shapes, ``(n, D)``.
        known_shapes: those shapes, ``(n,)``.
        test: numbers of other touches, ``(m, D)``.
        num_neighbours: touches that vote.

    Returns:
        ``(m,)``.
    """
    scale = known.std(axis=0) + np.finfo(float).tiny
    tree = KDTree(known / scale)
    last, _ = np.asarray(tree.query(test / scale, k=[min(num_neighbours, len(known))]))  # (m, 1)
    within = np.nextafter(last[:, 0] * (1 + 1e-12), np.inf)  # distances are computed twice, in different order
    voters = tree.query_ball_point(test / scale, within)
    return np.array([np.bincount(known_shapes[rows]).argmax() for rows in voters])
