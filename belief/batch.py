"""Touches of many objects as arrays, which is how observation models compute."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from belief.problem import Floats, Touch


@dataclass(frozen=True, eq=False)
class TouchBatch:
    """S sequences of n touches each; the touches of one sequence are of one object.

    Attributes:
        poses: ``(S, n)``.
        logits: ``(S, n, K)``, finite.
        features: ``(S, n, D)``, finite, or None where they were not kept.

    Raises:
        ValueError: the arrays do not fit each other, or hold NaN, infinities or a negative pose.

    Example:
        >>> batch = TouchBatch.of([[Touch(0, np.array([2.0, 0.0])), Touch(1, np.array([1.0, 0.5]))]])
        >>> batch.logits.shape, len(batch), [touch.pose for touch in batch.sequence(0)]
        ((1, 2, 2), 1, [0, 1])
    """

    poses: NDArray[np.int64]
    logits: Floats
    features: NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        poses, logits = np.asarray(self.poses), np.asarray(self.logits, np.float64)
        if poses.ndim != 2 or logits.shape[:2] != poses.shape or logits.ndim != 3 or logits.shape[2] == 0:
            raise ValueError(f"need poses (S, n) and logits (S, n, K), got {poses.shape} and {logits.shape}")
        if not np.issubdtype(poses.dtype, np.integer):
            raise ValueError(f"poses must be integers, got {poses.dtype}")
        if (poses < 0).any():
            sequence, touch = (int(i) for i in np.argwhere(poses < 0)[0])
            raise ValueError(f"touch {touch} of sequence {sequence} has pose {poses[sequence, touch]}, below 0")
        _require_finite("logits", logits)
        if self.features is not None:
            features = np.asarray(self.features)
            if features.ndim != 3 or features.shape[:2] != poses.shape:
                raise ValueError(f"features must be (S, n, D) with the poses' {poses.shape}, got {features.shape}")
            _require_finite("features", features)
            object.__setattr__(self, "features", features)
        object.__setattr__(self, "poses", poses.astype(np.int64))
        object.__setattr__(self, "logits", logits)

    @classmethod
    def of(cls, sequences: Sequence[Sequence[Touch]]) -> TouchBatch:
        """The batch of sequences of equal length, at least one touch in all.

        Raises:
            ValueError: no touch, lengths or logits that differ in shape, or values that are not finite; the message
                names the touch.
        """
        lengths = {len(sequence) for sequence in sequences}
        if len(lengths) != 1 or lengths == {0}:
            raise ValueError(f"need sequences of equal length with at least one touch, got lengths {sorted(lengths)}")
        touches = [touch for sequence in sequences for touch in sequence]
        num_shapes = np.shape(touches[0].logits)
        for index, touch in enumerate(touches):
            if np.shape(touch.logits) != num_shapes or len(num_shapes) != 1:
                raise ValueError(
                    f"touch {index} needs a row of logits, as many as the first has, got {np.asarray(touch.logits)}"
                )
        shape = (len(sequences), lengths.pop())
        rows = [touch.features for touch in touches]
        features = None if any(row is None for row in rows) else np.array(rows).reshape(*shape, -1)
        logits = np.array([touch.logits for touch in touches], np.float64).reshape(*shape, -1)
        return cls(np.array([touch.pose for touch in touches]).reshape(shape), logits, features)

    def __len__(self) -> int:
        """S, the number of sequences."""
        return len(self.poses)

    @property
    def num_touches(self) -> int:
        """Touches in each sequence, n."""
        return self.poses.shape[1]

    def sequence(self, row: int) -> list[Touch]:
        """One sequence as touches."""
        features: Iterator[NDArray[np.floating] | None]
        features = iter(self.features[row]) if self.features is not None else iter([None] * self.num_touches)
        return [Touch(int(p), z, f) for p, z, f in zip(self.poses[row], self.logits[row], features, strict=True)]

    def touches(self, columns: NDArray[np.integer] | slice) -> TouchBatch:
        """Some touches of every sequence."""
        features = None if self.features is None else self.features[:, columns]
        return TouchBatch(self.poses[:, columns], self.logits[:, columns], features)

    def first(self, num_touches: int) -> TouchBatch:
        """The first so many touches of every sequence."""
        return self.touches(slice(0, num_touches))


def _require_finite(name: str, values: NDArray[np.floating]) -> None:
    finite = np.isfinite(values).all(axis=2)
    if not finite.all():
        sequence, touch = (int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(f"touch {touch} of sequence {sequence} needs finite {name}, got {values[sequence, touch]}")
