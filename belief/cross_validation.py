"""Cross-validation folds of whole objects (all touches of an object are in the same fold)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.validation import require_count, unmasked


def numbered_objects(shapes: ArrayLike, object_ids: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Objects, numbered from 0 in ascending order of their ids.

    Args:
        shapes: true shape of each touch, ``(n,)``, integers.
        object_ids: object of each touch, ``(n,)``; any labels that can be sorted.

    Returns:
        The object of each touch, ``(n,)``, and the shape of each object, ``(N,)``.
    """
    truth, ids = unmasked(shapes, "shapes"), unmasked(object_ids, "object ids")
    if truth.ndim != 1 or truth.shape != ids.shape:
        raise ValueError(f"need a shape and an object id for every touch, got {truth.shape} and {ids.shape}")
    if not np.issubdtype(truth.dtype, np.integer):
        raise ValueError(f"shapes must be integers, got {truth.dtype}")
    if ids.dtype.kind in "fc" and np.isnan(ids).any():
        raise ValueError(f"row {int(np.isnan(ids).argmax())} has no object: its id is NaN")
    try:
        unique, first, owner = np.unique(ids, return_index=True, return_inverse=True)
    except TypeError as error:
        raise ValueError(f"object ids must be of one kind that can be sorted: {error}") from error
    shape_of = truth[first]
    wrong = shape_of[owner] != truth
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(
            f"object {unique[owner[row]]} has shape {shape_of[owner[row]]}, and in row {row} shape {truth[row]}"
        )
    return owner.astype(np.int64), shape_of.astype(np.int64)


def object_folds(shapes: ArrayLike, object_ids: ArrayLike, num_folds: int) -> NDArray[np.intp]:
    """Fold of each touch, ``(n,)``, in [0, num_folds).

    Folds are stratified by shape, with objects in ascending order of their ids. The order of the touches has no effect.
    The first arguments are those of :func:`numbered_objects`; ``num_folds`` is from 1 to the number of objects.
    """
    owner, shape_of = numbered_objects(shapes, object_ids)
    require_count("num_folds", num_folds)
    if num_folds > len(shape_of):
        raise ValueError(f"need between 1 and {len(shape_of)} folds for {len(shape_of)} objects, got {num_folds}")
    fold_of = np.empty(len(shape_of), np.intp)
    fold_of[np.argsort(shape_of, kind="stable")] = np.arange(len(shape_of)) % num_folds
    return fold_of[owner]
