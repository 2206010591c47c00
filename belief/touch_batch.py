"""Arrays of touches: S sequences of n touches each, the input of observation models."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.errors import InvalidArgument
from belief.frozen import FrozenArrays
from belief.problem import WHO_GIVES_LOGITS, Touch
from belief.validation import Floats, as_real, unmasked


@dataclass(frozen=True, eq=False)
class TouchBatch(FrozenArrays):
    """S sequences of n touches each, each sequence of one object; all arrays are read-only.

    Attributes:
        poses: ``(S, n)``.
        logits: ``(S, n, K)``, finite, or None; converted to float64.
        features: ``(S, n, F)``, finite, or None.

    Raises:
        ValueError: the arrays do not fit each other, are masked, or hold NaN, infinities or a pose that is negative or
            beyond 64 bits; the message names the touch. Or there are neither logits nor features.

    Example:
        >>> batch = TouchBatch.of([[Touch(0, np.array([2.0, 0.0])), Touch(1, np.array([1.0, 0.5]))]])
        >>> batch.logits.shape, len(batch), [touch.pose for touch in batch.sequence(0)]
        ((1, 2, 2), 1, [0, 1])
        >>> batch.first(1).poses.tolist(), batch.touches(slice(None, None, -1)).poses.tolist()
        ([[0]], [[1, 0]])
    """

    poses: NDArray[np.int64]
    logits: Floats | None = None
    features: NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        poses = unmasked(self.poses, "poses")
        if poses.ndim != 2:
            raise ValueError(f"need poses (S, n), got {poses.shape}")
        if not np.issubdtype(poses.dtype, np.integer):
            raise ValueError(f"poses must be integers, got {poses.dtype}")
        indices = poses.astype(np.int64, copy=False)
        if indices.size and indices.min() < 0:  # or too large for 64 bits with a sign
            sequence, touch = (int(i) for i in np.argwhere(indices < 0)[0])
            raise ValueError(
                f"touch {touch} of sequence {sequence} has pose {poses[sequence, touch]}, not in [0, 2^63)"
            )
        object.__setattr__(self, "poses", indices)
        if self.logits is None and self.features is None:
            raise InvalidArgument("all touches need logits (S, n, K), or all need features (S, n, F)")
        for name in ("logits", "features"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, self._checked(name))
        self.freeze()

    def _checked(self, name: str) -> NDArray[np.floating]:
        """One row of finite numbers for each touch; logits in double precision."""
        array = as_real(getattr(self, name), name)
        array = np.asarray(array, np.float64) if name == "logits" else array
        if array.ndim != 3 or array.shape[:2] != self.poses.shape or (name == "logits" and not array.shape[2]):
            shapes = f"{self.poses.shape} and {array.shape}"
            raise ValueError(f"need poses (S, n), and {name} must be a row for each (S, n, …), got {shapes}")
        if not np.isfinite(array).all():
            sequence, touch = (int(i) for i in np.argwhere(~np.isfinite(array).all(axis=2))[0])
            raise ValueError(f"touch {touch} of sequence {sequence} needs finite {name}, got {array[sequence, touch]}")
        return array

    @classmethod
    def of(cls, sequences: Sequence[Sequence[Touch]]) -> TouchBatch:
        """The batch of sequences of equal length; without logits, or features, unless all touches have them.

        Raises:
            ValueError: no touch, different lengths, neither logits nor features that all touches have; logits of
                different shapes, or values that are not finite: the message names the touch.
        """
        lengths = {len(sequence) for sequence in sequences}
        if len(lengths) != 1 or lengths == {0}:
            raise ValueError(f"need sequences of equal length with at least one touch, got lengths {sorted(lengths)}")
        shape = (len(sequences), lengths.pop())
        touches = [touch for sequence in sequences for touch in sequence]
        for index, touch in enumerate(touches):
            if not isinstance(touch, Touch):
                place = f"touch {index % shape[1]} of sequence {index // shape[1]}"
                raise InvalidArgument(f"{place} must be a Touch, such as Touch(pose, logits), got {touch!r:.60}")
            if touch.elsewhere is not None:
                raise InvalidArgument(
                    f"touch {index} was made at {touch.elsewhere.place}, which is none of the poses; only the evidence "
                    "of a model of one rigid body takes such touches, one after the other"
                )
        poses = np.array([touch.pose for touch in touches])
        return cls(poses.reshape(shape), _stacked("logits", touches, shape), _stacked("features", touches, shape))

    def __len__(self) -> int:
        """S, the number of sequences."""
        return len(self.poses)

    @property
    def num_touches(self) -> int:
        """n, the number of touches in each sequence."""
        return self.poses.shape[1]

    @property
    def num_shapes(self) -> int:
        """K; raises InvalidArgument for touches without logits."""
        return self.require_logits().shape[2]

    def require_logits(self) -> Floats:
        """The logits, ``(S, n, K)``.

        Raises:
            InvalidArgument: the touches have no logits.
        """
        if self.logits is None:
            raise InvalidArgument(f"these touches have no logits{WHO_GIVES_LOGITS}")
        return self.logits

    def take(self, index: Any) -> TouchBatch:
        """The batch of touches at an index of arrays ``(S, n)``, which must give arrays of two axes.

        >>> batch = TouchBatch(np.array([[0, 1, 2]]), features=np.zeros((1, 3, 8)))
        >>> batch.take((0, [[2], [0]])).poses.tolist()
        [[2], [0]]
        """
        return self._of_each(lambda array: array[index])

    def reshaped(self, shape: tuple[int, int]) -> TouchBatch:
        """The touches in sequences of another ``shape``, number and length; one of the two may be -1."""
        return self._of_each(lambda array: array.reshape(*shape, *array.shape[2:]))

    def _of_each(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> TouchBatch:
        logits, features = (None if array is None else change(array) for array in (self.logits, self.features))
        return TouchBatch(change(self.poses), logits, features)

    def sequence(self, row: int) -> list[Touch]:
        """One sequence as touches."""
        nothing = [None] * self.num_touches
        rows = (nothing if array is None else list(array[row]) for array in (self.logits, self.features))
        return [Touch(int(pose), *arrays) for pose, *arrays in zip(self.poses[row], *rows, strict=True)]

    def touches(self, columns: NDArray[np.integer] | slice) -> TouchBatch:
        """The batch of selected touches of every sequence."""
        return self.take((slice(None), columns))

    def sequences(self, rows: NDArray[np.integer] | slice) -> TouchBatch:
        """The batch of selected sequences."""
        return self.take(rows)

    def first(self, num_touches: int) -> TouchBatch:
        """The batch of the first touches of every sequence."""
        return self.touches(slice(0, num_touches))


def grouped(batch: TouchBatch, groups: ArrayLike) -> Iterator[tuple[TouchBatch, NDArray[np.int64]]]:
    """Touches grouped into sequences, each in its original order.

    Args:
        batch: all touches as one sequence, n of them.
        groups: sequence of each touch, ``(n,)``; any labels.

    Yields:
        For each length, the sequences of that length and the rows of their touches, ``(S, length)``.

    >>> batch = TouchBatch(np.zeros((1, 5), int), np.zeros((1, 5, 2)))
    >>> [rows.tolist() for _, rows in grouped(batch, ["mug", "ball", "mug", "cup", "mug"])]
    [[[1], [3]], [[0, 2, 4]]]
    """
    _, index, sizes = np.unique(np.asarray(groups), return_inverse=True, return_counts=True)
    order, first = np.argsort(index, kind="stable"), np.concatenate([[0], sizes.cumsum()[:-1]])
    for size in np.unique(sizes).tolist():
        rows = order[first[sizes == size][:, None] + np.arange(size)]
        yield batch.take((0, rows)), rows


def _stacked(name: str, touches: Sequence[Touch], shape: tuple[int, int]) -> NDArray[Any] | None:
    """Rows of touches as ``(S, n, …)``; None unless all touches have one."""
    rows = [row for touch in touches if (row := getattr(touch, name)) is not None]
    if len(rows) < len(touches):
        return None
    for index, row in enumerate(rows):
        if row.ndim != 1 or row.shape != rows[0].shape:
            place = f"touch {index % shape[1]} of sequence {index // shape[1]}"
            raise ValueError(f"{place} needs a row of {name}, as many as in the first touch, got {row!r}")
    return as_real(rows, name).reshape(*shape, -1)
