"""Folds of whole objects for cross-validation: touches of one object never sit on both sides."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def object_folds(shapes: ArrayLike, object_ids: ArrayLike, num_folds: int) -> NDArray[np.intp]:
    """Which fold each touch is in, ``(n,)``, in [0, num_folds).

    Objects are dealt out shape by shape, in rising order of their ids: every fold gets its share of every shape, and
    the order of the touches changes nothing.

    Args:
        shapes: true shape of each touch, ``(n,)``.
        object_ids: which object it is of, ``(n,)``.
        num_folds: at least 1 (all together), at most the number of objects.

    Raises:
        ValueError: too few objects for the folds, an object of two shapes, or lengths that differ.

    >>> object_folds([0, 0, 1, 0, 1], [7, 7, 3, 9, 5], num_folds=2)
    array([0, 0, 0, 1, 1])
    """
    truth, ids = np.asarray(shapes), np.asarray(object_ids)
    if truth.ndim != 1 or truth.shape != ids.shape:
        raise ValueError(f"need a shape and an object id for every touch, got {truth.shape} and {ids.shape}")
    unique, first, owner = np.unique(ids, return_index=True, return_inverse=True)
    if not 1 <= num_folds <= len(unique):
        raise ValueError(f"need between 2 and {len(unique)} folds for {len(unique)} objects, got {num_folds}")
    shape_of = truth[first]
    if (shape_of[owner] != truth).any():
        row = int(np.argmax(shape_of[owner] != truth))
        raise ValueError(f"object {ids[row]} has shape {shape_of[owner[row]]}, and in row {row} shape {truth[row]}")
    fold_of = np.empty(len(unique), np.intp)
    fold_of[np.argsort(shape_of, kind="stable")] = np.arange(len(unique)) % num_folds
    return fold_of[owner]
