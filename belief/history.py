"""An immutable sequence of the touches of one object, oldest first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import overload

import numpy as np
from numpy.typing import NDArray

from belief.problem import Touch


class TouchHistory(Sequence[Touch]):
    """An immutable sequence of touches; :meth:`extended` returns a longer one without copying.

    Touches are ordered oldest first. A history and its extensions share one list, of which each shows its first part.

    >>> first = TouchHistory([Touch(0, np.zeros(2))])
    >>> longer = first.extended([Touch(2, np.zeros(2)), Touch(2, np.zeros(2))])
    >>> len(first), len(longer), longer.uses(num_poses=3).tolist()
    (1, 3, [1, 0, 2])
    """

    __slots__ = ("_length", "_shared", "_uses")

    def __init__(self, touches: Iterable[Touch] = ()) -> None:
        self._shared = list(touches)
        self._length = len(self._shared)
        self._uses = Counter(touch.pose for touch in self._shared)

    def extended(self, touches: Iterable[Touch]) -> TouchHistory:
        """This history followed by these touches; the time is linear in the number of new touches."""
        longer = object.__new__(TouchHistory)
        is_newest = len(self._shared) == self._length  # otherwise the shared list already has another extension
        longer._shared = self._shared if is_newest else self._shared[: self._length]
        longer._shared.extend(touches)
        longer._length = len(longer._shared)
        longer._uses = self._uses.copy()
        longer._uses.update(touch.pose for touch in longer._shared[self._length :])
        return longer

    def uses(self, num_poses: int) -> NDArray[np.int64]:
        """Number of touches in each pose, ``(P,)``.

        Raises:
            ValueError: a touch has a pose that is out of range.
        """
        uses = np.zeros(num_poses, np.int64)
        for pose, times in self._uses.items():
            if not 0 <= pose < num_poses:
                raise ValueError(f"a touch was made in pose {pose}, there are {num_poses} poses")
            uses[pose] = times
        return uses

    @overload
    def __getitem__(self, index: int) -> Touch: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Touch]: ...
    def __getitem__(self, index: int | slice) -> Touch | Sequence[Touch]:
        if isinstance(index, slice):
            return tuple(self._shared[i] for i in range(*index.indices(self._length)))
        if not -self._length <= index < self._length:
            raise IndexError(f"there are {self._length} touches, asked for number {index}")
        return self._shared[index % self._length]

    def __len__(self) -> int:
        return self._length

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TouchHistory | tuple):
            return NotImplemented
        return tuple(self) == tuple(other)

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __reduce__(self) -> tuple[type[TouchHistory], tuple[tuple[Touch, ...]]]:
        return TouchHistory, (tuple(self),)

    def __repr__(self) -> str:
        return f"TouchHistory({list(self)!r})"
