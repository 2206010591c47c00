"""Calibration touches, to which observation models are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.frozen import FrozenArrays
from belief.naming import checked_names
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import Floats, at, checked_indices, pose_count, require_count, unmasked


def numbered_objects(shapes: ArrayLike, object_ids: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Object of each touch, ``(n,)``, numbered in ascending order of ids, and the shape of each object, ``(N,)``."""
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
            f"object {unique[owner[row]]} has shape {shape_of[owner[row]]}, and shape {truth[row]}{at((row,))}"
        )
    return owner.astype(np.int64), shape_of.astype(np.int64)


def object_folds(shapes: ArrayLike, object_ids: ArrayLike, num_folds: int) -> NDArray[np.intp]:
    """Fold of each touch, ``(n,)``, stratified by shape; the order of the touches has no effect."""
    owner, shape_of = numbered_objects(shapes, object_ids)
    require_count("num_folds", num_folds)
    if num_folds > len(shape_of):
        fewer = f", or give num_folds={len(shape_of)}" if len(shape_of) > 1 else ""
        raise ValueError(
            f"{num_folds} folds of whole objects need as many objects, got {len(shape_of)}: record more{fewer}"
        )
    fold_of = np.empty(len(shape_of), np.intp)
    fold_of[np.argsort(shape_of, kind="stable")] = np.arange(len(shape_of)) % num_folds
    return fold_of[owner]


@dataclass(frozen=True, eq=False)
class LabelledTouches(FrozenArrays):
    """n touches of N objects, numbered from 0: ``shapes (n,)``, ``objects (n,)`` and ``shape_of_object (N,)``."""

    batch: TouchBatch
    shapes: NDArray[np.int64]
    objects: NDArray[np.int64]
    shape_of_object: NDArray[np.int64]
    shape_labels: tuple[str, ...]
    num_poses: int

    @classmethod
    def of(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike | None,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
    ) -> LabelledTouches:
        """The data of touches with labels.

        Args:
            touches: at least one, of objects outside the classifier's training set.
            shapes: true shape index of each, ``(n,)``.
            object_ids: object of each, ``(n,)``, any labels; by default every touch is of another object.
            shape_labels: names of the shapes; by default ``shape_0`` and so on.
            num_poses: P; by default one more than the largest pose in the data.
        """
        truth = unmasked(shapes, "shapes")
        ids = np.arange(len(touches)) if object_ids is None else unmasked(object_ids, "object_ids")
        if len(touches) == 0 or truth.shape != (len(touches),) or ids.shape != truth.shape:
            raise ValueError(
                f"need at least one touch, and one shape and object for each, got {len(touches)} touches, "
                f"{truth.shape} shapes and {ids.shape} objects"
            )
        batch = TouchBatch.of([touches])
        num_shapes = batch.num_shapes
        if num_shapes < 2:
            raise ValueError("need logits of at least two shapes, got one")
        truth = checked_indices("shapes", truth, num_shapes)
        objects, shape_of_object = numbered_objects(truth, ids)
        labels = tuple(f"shape_{k}" for k in range(num_shapes))
        if shape_labels is not None:
            labels = checked_names("shape_labels", shape_labels)
        if len(labels) != num_shapes:
            raise ValueError(f"the touches have {num_shapes} logits, shape_labels names {len(labels)}: {list(labels)}")
        size = pose_count(batch.poses[0], num_poses)
        return cls(batch, truth, objects, shape_of_object, labels, size)

    def of_rows(self, kept: NDArray[np.bool_]) -> LabelledTouches:
        """The touches for which ``kept (n,)`` is true; their objects are numbered anew."""
        numbered = numbered_objects(self.shapes[kept], self.objects[kept])
        return LabelledTouches(
            self.batch.touches(np.flatnonzero(kept)), self.shapes[kept], *numbered, self.shape_labels, self.num_poses
        )

    @property
    def logits(self) -> Floats:
        """``(n, K)``."""
        return self.batch.require_logits()[0]

    @property
    def poses(self) -> NDArray[np.int64]:
        """``(n,)``."""
        return self.batch.poses[0]

    @property
    def num_shapes(self) -> int:
        """K."""
        return self.batch.num_shapes

    @property
    def num_objects(self) -> int:
        """N."""
        return len(self.shape_of_object)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Touches of each shape, ``(K,)``."""
        return np.bincount(self.shapes, minlength=self.num_shapes)

    def rows_of_poses(self, number: int, groups: Sequence[int] = ()) -> NDArray[np.int64]:
        """Rows of ``number`` touches in each pose, evenly spaced in the data, ``(P, number)``.

        A pose without touches gets rows of all poses. Poses with the same number in ``groups`` count as one.
        """
        rows, of_touch = [], np.array(groups)[self.poses] if groups else self.poses
        for pose in range(1 + max(groups) if groups else self.num_poses):
            here = np.flatnonzero(of_touch == pose)
            here = here if here.size else np.arange(len(self.poses))
            rows.append(here[np.linspace(0, len(here) - 1, number).round().astype(int)])
        return np.stack(rows)
