"""What a touch gives away without a network: shape guessed from force and depth alone, or by the nearest known image.

A classifier that sees images should owe its accuracy to them. This baseline bounds what could leak through the two
numbers a press ends with: the majority among the nearest other touches in (force, depth). The nearest known image tells
what could leak through near copies.
"""

from __future__ import annotations

import math

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
        known: touches whose shapes are told.
        test: touches of other objects.
        num_neighbours: touches that vote.
    """
    return neighbour_accuracy(_numbers(known), known.shapes, _numbers(test), test.shapes, num_neighbours)


def neighbour_accuracy(
    known: Floats, known_shapes: Integers, test: Floats, test_shapes: Integers, num_neighbours: int
) -> float:
    """Share of test rows that :func:`neighbour_guesses` gets right.

    Args:
        known: numbers of touches whose shapes are told, ``(n, D)``.
        known_shapes: those shapes, ``(n,)``.
        test: numbers of other touches, ``(m, D)``.
        test_shapes: their shapes, ``(m,)``.
        num_neighbours: touches that vote.
    """
    return float(np.mean(neighbour_guesses(known, known_shapes, test, num_neighbours) == test_shapes))


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


def cross_fitted_guesses(numbers: Floats, shapes: Integers, object_ids: Integers, num_folds: int = 5) -> Integers:
    """The shape of every touch, guessed from the touches of other objects: nobody is asked about their own.

    The objects are split into folds, and those of one guessed by the votes of √n among the n touches of the others.

    Args:
        numbers: what is known of each touch, ``(N, D)``.
        shapes: true ones, ``(N,)``.
        object_ids: of the objects touched, ``(N,)``.
        num_folds: at most one for every object.

    Returns:
        ``(N,)``.

    Raises:
        ValueError: there are no two objects.
    """
    objects, rank = np.unique(object_ids, return_inverse=True)
    if len(objects) < 2:
        raise ValueError(f"need touches of at least two objects to guess one from the others, got {len(objects)}")
    folds = min(num_folds, len(objects))
    fold = rank * folds // len(objects)
    guesses = np.empty_like(shapes)
    for number in range(folds):
        test = fold == number
        num_neighbours = max(1, math.isqrt(np.count_nonzero(~test)))
        guesses[test] = neighbour_guesses(numbers[~test], shapes[~test], numbers[test], num_neighbours)
    return guesses


def share_by_object(right: NDArray[np.bool_], object_ids: Integers) -> Floats:
    """Share of right guesses for every object, in order of its id; what a bootstrap of objects resamples.

    Args:
        right: whether the guess of a touch was, ``(N,)``.
        object_ids: of the objects touched, ``(N,)``.
    """
    _, rank = np.unique(object_ids, return_inverse=True)
    return np.bincount(rank, right) / np.bincount(rank)


def shares_without_image(numbers: Floats, shapes: Integers, object_ids: Integers) -> dict[str, Floats]:
    """Share of right guesses for every object from its touches' force, from their depth, and from both.

    Args:
        numbers: force and depth of each touch, ``(N, 2)``.
        shapes: true ones, ``(N,)``.
        object_ids: of the objects touched, ``(N,)``.
    """
    known = {"force": numbers[:, :1], "depth": numbers[:, 1:], "force and depth": numbers}
    return {
        name: share_by_object(cross_fitted_guesses(columns, shapes, object_ids) == shapes, object_ids)
        for name, columns in known.items()
    }


def _numbers(touches: TouchSet) -> Floats:
    return np.column_stack([touches.forces, touches.depths])


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
