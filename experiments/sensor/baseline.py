"""What a touch tells without a network: shape guessed from force and depth alone, or by the nearest known image.

A classifier of images should owe its accuracy to them. The majority among the nearest other touches in (force, depth)
shows what these two numbers tell, the nearest known image what near copies tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from activetouch.data.dataset import TouchSet

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def depth_and_force_accuracy(known: TouchSet, test: TouchSet, num_neighbours: int = 51) -> float:
    """Share of test touches whose shape the nearest known touches in (force, depth) vote for.

    Args:
        known: touches with known shapes.
        test: touches of other objects.
        num_neighbours: touches that vote.
    """
    numbers, asked = (np.column_stack([touches.forces, touches.depths]) for touches in (known, test))
    return float(np.mean(neighbour_guesses(numbers, known.shapes, asked, num_neighbours) == test.shapes))


def neighbour_guesses(known: Floats, known_shapes: Integers, test: Floats, num_neighbours: int) -> Integers:
    """The shape that the majority of the nearest known rows has, columns scaled alike, for every test row.

    All rows as near as the last voter vote, too: presses that bottom out share one depth, and which of them a search
    comes upon first would decide.

    Args:
        known: numbers of touches whose shapes are told, ``(n, D)``.
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


def averaged(images: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Images ``(n, H, H)`` or ``(n, H, H, 3)`` averaged to ``size`` pixels an edge; unchanged if H is no multiple."""
    factor, rest = divmod(images.shape[1], size)
    if rest or factor <= 1:
        return images
    blocks = images.reshape(len(images), size, factor, size, factor, -1).mean(axis=(2, 4))
    return np.rint(blocks).astype(np.uint8).reshape(len(images), size, size, *images.shape[3:])


def nearest_image_guesses(known: TouchSet, test: TouchSet, size: int = 32) -> Integers:
    """Shape of the known image nearest to each test image, pixel by pixel, ``(m,)``; averaged to ``size`` pixels."""
    first, second = (averaged(t.images, size).reshape(len(t.images), -1).astype(float) for t in (test, known))
    return known.shapes[cdist(first, second).argmin(axis=1)]
