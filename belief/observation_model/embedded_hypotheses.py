"""Embedded hypotheses of a body: what embeds them, and the table that touches are compared with, in every pose.

One pose, one shape, two hypotheses; then a touch that fits the first:

>>> table = np.array([[[[3.0, 0.0], [0.0, 3.0]]]], np.float32)
>>> hypotheses = EmbeddedHypotheses(FixedHypotheses(table), (1, 1, 2, 2), (), temperature=1.0)
>>> hypotheses.scores(0, np.array([[1.0, 0.5]])).tolist()
[[[3.0, 1.5]]]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from belief.frozen import FrozenArrays, frozen
from belief.observation_model.model import Embeds
from belief.observation_model.views import Views
from belief.validation import Floats, as_real

Floats32 = NDArray[np.float32]

_LARGEST, _LARGEST_OF_HYPOTHESES = 1e30, 1e6  # numbers in embeddings of touches and of hypotheses


@runtime_checkable
class EmbedsByPose(Embeds, Protocol):
    """Embeds hypotheses one pose at a time, and knows which poses share references.

    It is for many poses, whose table is large. See :class:`~belief.observation_model.views.Views`.
    """

    @property
    def groups(self) -> tuple[int, ...]:
        """Of the poses that share references, one number for each pose; empty if every pose has its own."""

    def in_pose(self, num_hypotheses: int, pose: int) -> NDArray[np.floating]:
        """Embedded hypotheses in one pose, ``(K, N, D)``, kept for the next call."""

    def views(self, num_hypotheses: int) -> Views:
        """Which hypotheses look alike in different poses."""


@dataclass(frozen=True, eq=False)
class FixedHypotheses(FrozenArrays):
    """Hypotheses that are embedded already.

    Attributes:
        table: the embedded hypotheses of every pose, ``(P, K, N, D)``, read-only; ``(P, K, N, A · D)`` with A
            alternatives of each.

    >>> FixedHypotheses(np.zeros((6, 4, 512, 64), np.float32))(512).shape
    (6, 4, 512, 64)
    """

    table: Floats32

    def __post_init__(self) -> None:
        if np.ndim(self.table) != 4:
            raise ValueError(f"embedded hypotheses must be (P, K, N, D), got {np.shape(self.table)}")
        require_table(self.table, np.shape(self.table))
        self.freeze()

    def __call__(self, num_hypotheses: int) -> Floats32:
        """The table, whatever is asked for; who asks checks its shape."""
        return self.table

    def freeze(self) -> None:
        """Lay the table out for comparison with touches, also after pickling, and make it read-only."""
        object.__setattr__(self, "table", _numbers_first(np.asarray(self.table)))


@dataclass(frozen=True, eq=False)
class EmbeddedHypotheses:
    """N hypotheses of each of K shapes in P poses, embedded at first use, and the log ratios of touches under them.

    Attributes:
        embed: embeds them.
        shape: P, K, N and D.
        groups: of the poses that share references; empty for none. With groups, ``embed`` embeds by pose.
        temperature: by which log ratios are divided.
    """

    embed: Embeds
    shape: tuple[int, int, int, int]
    groups: tuple[int, ...]
    temperature: float

    def scores(self, pose: int, embeddings: Floats, shapes: slice = slice(None)) -> Floats32:
        """Log p(touch | hypothesis) of embeddings ``(n, D)`` in a pose, up to a constant of each, ``(n, K, N)``."""
        return self.scores_under(self.in_pose(pose)[shapes], embeddings)

    def scores_under(self, table: NDArray[np.floating], embeddings: Floats) -> Floats32:
        """:meth:`scores` under embedded hypotheses ``(K, N, D)``, or ``(K, N, A · D)``."""
        number, width = self.shape[2:]
        if table.shape[1] != number or len(table) > self.shape[1] or table.shape[2] % width or not table.shape[2]:
            raise ValueError(f"hypotheses must be {self.shape[1:]} (shapes, N, D), got {table.shape}")
        return log_ratios(embeddings, table, self.temperature)

    def in_pose(self, pose: int) -> Floats32:
        """The embedded hypotheses of one pose, ``(K, N, D)``; where poses share references, embedded at first use."""
        if self._by_pose is None:
            return self.table[pose]
        found = np.asarray(self._by_pose.in_pose(self.shape[2], pose), np.float32)
        if pose not in self._checked:
            require_table(found, self.shape[1:])
            self._checked.add(pose)
        return found

    @cached_property
    def _checked(self) -> set[int]:
        return set()

    @cached_property
    def table(self) -> Floats32:
        """The embedded hypotheses of every pose, ``(P, K, N, D)``, read-only."""
        table = self.embed(self.shape[2])
        require_table(table, self.shape)
        return _numbers_first(np.asarray(table))

    @cached_property
    def views(self) -> Views | None:
        """Which hypotheses look alike in different poses; None if every pose has references of its own."""
        if self._by_pose is None:
            return None
        found = self._by_pose.views(self.shape[2])
        if found.groups.tolist() != list(self.groups):
            raise ValueError(f"the hypotheses are for poses of the groups {found.groups.tolist()}, not {self.groups}")
        return found

    @cached_property
    def _by_pose(self) -> EmbedsByPose | None:
        return self.embed if self.groups and isinstance(self.embed, EmbedsByPose) else None


def scaled(embeddings: Floats, temperature: float) -> Floats32:
    """Embeddings by temperature in single precision, limited to numbers whose products do not overflow."""
    with np.errstate(over="ignore"):
        by_temperature = np.asarray(embeddings, np.float64) / temperature
    return np.clip(by_temperature, -_LARGEST, _LARGEST).astype(np.float32)


def log_ratios(embeddings: Floats, table: NDArray[np.floating], temperature: float) -> Floats32:
    """Log ratios of n touches under embedded hypotheses, ``(n, ...)``, divided by the temperature.

    Args:
        embeddings: of the touches, ``(n, D)``.
        table: of the hypotheses, ``(..., D)``; or ``(..., A · D)`` of A alternatives, such as a nuisance that each
            touch draws anew: the ratio is their mean.
        temperature: above 0.
    """
    width = embeddings.shape[1]
    if table.shape[-1] == width:
        found = scaled(embeddings, temperature) @ table.reshape(-1, width).T
    else:
        rows, alternatives = scaled(embeddings, 1.0), np.split(table, table.shape[-1] // width, axis=-1)
        each = (rows @ some.reshape(-1, width).T for some in alternatives)
        found = (reduce(np.logaddexp, each) - np.float32(np.log(len(alternatives)))) / np.float32(temperature)
    return np.asarray(found.reshape(len(embeddings), *table.shape[:-1]))


def require_table(table: Floats32, shape: tuple[int, ...]) -> None:
    """Check embedded hypotheses, of one or more alternatives."""
    values = as_real(table, "hypotheses")
    if values.shape[:-1] != shape[:-1] or values.shape[-1] % shape[-1] or not values.shape[-1]:
        raise ValueError(f"hypotheses must be {shape} ((poses,) shapes, N, D), got {values.shape}")
    if not np.isfinite(values).all():
        place = np.argwhere(~np.isfinite(values))[0].tolist()
        raise ValueError(f"hypotheses must be finite, got {values[tuple(place)]} at {place}")
    if values.size and float(max(values.max(), -values.min())) > _LARGEST_OF_HYPOTHESES:
        raise ValueError(f"hypotheses must be numbers of at most {_LARGEST_OF_HYPOTHESES:g} in size, got larger ones")


def _numbers_first(table: Floats32) -> Floats32:
    """The table ``(P, K, N, D)``, read-only, with the numbers of one dimension next to each other in memory."""
    laid_out = np.ascontiguousarray(np.moveaxis(table, 3, 1))
    return np.moveaxis(frozen(laid_out), 1, 3)
