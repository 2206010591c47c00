"""Embedded hypotheses of a body: the table that touches are compared with, in every pose.

One pose, one shape, two hypotheses; then a touch that fits the first:

>>> table = np.array([[[[3.0, 0.0], [0.0, 3.0]]]], np.float32)
>>> require_table(table, (1, 1, 2, 2))
>>> hypotheses = EmbeddedHypotheses(numbers_first(table), (1, 1, 2, 2), (), temperature=1.0)
>>> hypotheses.scores(0, np.array([[1.0, 0.5]])).tolist()
[[[3.0, 1.5]]]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from belief.frozen import frozen
from belief.observation_model.model import Embeds
from belief.observation_model.views import Views
from belief.problem import Floats
from belief.validation import as_real

Floats32 = NDArray[np.float32]

_LARGEST = 1e30  # number in an embedding


@dataclass(frozen=True, eq=False)
class EmbeddedHypotheses:
    """N hypotheses of each of K shapes in P poses, embedded at first use, and the log ratios of touches under them.

    Attributes:
        source: the embedded hypotheses ``(P, K, N, D)``, or what embeds them; None if they are not known yet.
        shape: P, K, N and D.
        groups: of the poses that share references (:class:`~belief.observation_model.views.Views`); empty for none.
        temperature: by which log ratios are divided.
    """

    source: Floats32 | Embeds | None
    shape: tuple[int, int, int, int]
    groups: tuple[int, ...]
    temperature: float

    def scores(self, pose: int, embeddings: Floats, shapes: slice = slice(None)) -> Floats32:
        """Log p(touch | shape, orientation, size) of touches in one pose, up to a constant of the touch, ``(n, K, N)``.

        Args:
            pose: index.
            embeddings: of the touches, ``(n, D)``.
            shapes: of the hypotheses; all by default.

        Raises:
            ValueError: there are no hypotheses yet.
        """
        table = self.in_pose(pose)[shapes]
        return (self.scaled(embeddings) @ table.reshape(-1, table.shape[-1]).T).reshape(-1, *table.shape[:2])

    def scaled(self, embeddings: Floats) -> Floats32:
        """Embeddings by temperature in single precision, limited to numbers whose products do not overflow."""
        with np.errstate(over="ignore"):
            scaled = np.asarray(embeddings, np.float64) / self.temperature
        return np.clip(scaled, -_LARGEST, _LARGEST).astype(np.float32)

    def in_pose(self, pose: int) -> Floats32:
        """The embedded hypotheses of one pose, ``(K, N, D)``; where poses share references, embedded at first use."""
        if not self.groups or isinstance(self.source, np.ndarray) or self.source is None:
            return self.table[pose]
        found = np.asarray(self.source.in_pose(self.shape[2], pose), np.float32)  # type: ignore[attr-defined]
        if pose == 0:
            require_table(found, self.shape[1:])
        return found

    @cached_property
    def table(self) -> Floats32:
        """The embedded hypotheses of every pose, ``(P, K, N, D)``, read-only.

        Raises:
            ValueError: there are no hypotheses yet, or they do not fit.
        """
        if self.source is None:
            raise ValueError("the model was read from a file and has no hypotheses yet; call with_hypotheses(embed)")
        if isinstance(self.source, np.ndarray):
            return self.source
        table = self.source(self.shape[2])
        require_table(table, self.shape)
        return numbers_first(np.asarray(table))

    @cached_property
    def views(self) -> Views | None:
        """Which hypotheses look alike in different poses; None if every pose has references of its own."""
        if not self.groups:
            return None
        found: Views = self.source.views(self.shape[2])  # type: ignore[union-attr]
        if found.groups.tolist() != list(self.groups):
            raise ValueError(f"the hypotheses are for poses of the groups {found.groups.tolist()}, not {self.groups}")
        return found


def require_table(table: Floats32, shape: tuple[int, ...]) -> None:
    """Check embedded hypotheses.

    Raises:
        ValueError: they have another shape, masked entries, NaN or infinity, or are not real numbers.

    >>> require_table(np.full((1, 2, 1, 1), np.nan, np.float32), (1, 2, 1, 1))
    Traceback (most recent call last):
    ...
    ValueError: hypotheses must be finite, got nan at [0, 0, 0, 0]
    """
    values = as_real(table, "hypotheses")
    if values.shape != shape:
        raise ValueError(f"hypotheses must be {shape} ((poses,) shapes, N, D), got {values.shape}")
    if not np.isfinite(values).all():
        place = np.argwhere(~np.isfinite(values))[0].tolist()
        raise ValueError(f"hypotheses must be finite, got {values[tuple(place)]} at {place}")


def numbers_first(table: Floats32) -> Floats32:
    """The table ``(P, K, N, D)``, read-only, with the numbers of one dimension next to each other in memory.

    This halves the time in which one embedding is compared with all hypotheses of a pose.
    """
    laid_out = np.ascontiguousarray(np.moveaxis(table, 3, 1))
    return np.moveaxis(frozen(laid_out), 1, 3)
