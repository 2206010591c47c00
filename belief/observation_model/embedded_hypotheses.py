"""Embedded hypotheses of a body: what embeds them, and the table that touches are compared with, in every pose.

One pose, one shape, two hypotheses; then a touch that fits the first:

>>> table = np.array([[[[3.0, 0.0], [0.0, 3.0]]]], np.float32)
>>> hypotheses = EmbeddedHypotheses(FixedHypotheses(table), (1, 1, 2, 2), (), temperature=1.0)
>>> hypotheses.scores(0, np.array([[1.0, 0.5]])).tolist()
[[[3.0, 1.5]]]
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from belief.frozen import FrozenArrays, frozen
from belief.observation_model.model import Embeds
from belief.observation_model.outcome_mixture import Views, bounded_softmax, log_sums
from belief.validation import Floats, as_real

if TYPE_CHECKING:
    from belief.touch_batch import TouchBatch

Floats32 = NDArray[np.float32]

_LARGEST, _LARGEST_OF_HYPOTHESES = 1e30, 1e6  # numbers in embeddings of touches and of hypotheses


@runtime_checkable
class EmbedsByPose(Embeds, Protocol):
    """Embeds hypotheses one pose at a time, and knows which poses share references.

    It is for many poses, whose table is large. See :class:`~belief.observation_model.outcome_mixture.Views`.
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
    """Embeddings by temperature in single precision, each made so short that its products do not overflow."""
    rows = np.asarray(embeddings, np.float64)
    sizes = np.abs(rows).max(axis=-1, keepdims=True, initial=0.0)
    return np.asarray(rows / np.maximum(temperature, sizes / _LARGEST), np.float32)


def log_ratios(embeddings: Floats, table: NDArray[np.floating], temperature: float) -> Floats32:
    """Log ratios ``(n, ...)`` of touches ``(n, D)`` under embedded hypotheses ``(..., D)``, by the temperature.

    A table ``(..., A · D)`` holds A alternatives, such as a nuisance that each touch draws anew: the ratio is their
    mean.
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


_AT_ONCE = 1 << 22  # numbers, of log weights that are worked on at a time
_MOST_OUTCOMES = 1 << 25  # numbers, of probabilities of outcomes under all hypotheses that are kept, pose by pose


@dataclass(frozen=True, eq=False)
class ReferenceOutcomes:
    """Touches that stand for all as outcomes of the next touch; what is computed once is kept.

    A learned ratio has no density over images, so the next touch is supposed to be one of some reference touches:
    p(reference | hypothesis) is proportional to its ratio under that hypothesis, over its mean ratio under all.

    >>> table = np.array([[[[3.0, 0.0], [0.0, 3.0]]]], np.float32)  # one pose, one shape, two hypotheses
    >>> hypotheses = EmbeddedHypotheses(FixedHypotheses(table), (1, 1, 2, 2), (), temperature=1.0)
    >>> outcomes = ReferenceOutcomes(hypotheses, references=np.eye(2)[None], logits=np.zeros((1, 2, 1)))
    >>> outcomes.of(np.array([[0, 1]]), num_outcomes=2).astype(float).round(2).tolist()
    [[[[0.95, 0.05], [0.05, 0.95]]]]

    Attributes:
        hypotheses: of the body.
        references: embeddings of M touches of each pose or group of poses, ``(G, M, D)``.
        logits: the shape logits of these, ``(G, M, K)``.
    """

    hypotheses: EmbeddedHypotheses
    references: Floats
    logits: Floats

    def of(self, chosen: NDArray[np.int64], num_outcomes: int) -> Floats32:
        """p(reference touch | pose, hypothesis) of hypotheses ``chosen (K, H)``, ``(P, K, H, M)``; M are even."""
        if (views := self.hypotheses.views) is not None:
            return views.of_all_poses(self.shared(num_outcomes), chosen)
        num_poses, num_shapes, number = self.hypotheses.shape[:3]
        num_kept = min(_MOST_OUTCOMES // (num_shapes * number * num_outcomes), num_poses)
        kept = _evenly(self.references.shape[1], num_outcomes)
        rows = (np.arange(num_shapes)[:, None] * number + chosen).ravel()
        found = np.empty((num_poses, rows.size, len(kept)), np.float32)
        for pose in range(num_kept):
            self._kept(pose, num_outcomes).reshape(-1, len(kept)).take(rows, axis=0, out=found[pose], mode="clip")
        for pose in range(num_kept, num_poses):
            table = np.moveaxis(self.hypotheses.table[pose], 2, 0).reshape(-1, num_shapes * number)[:, rows].T
            scores = log_ratios(self.references[pose, kept], table, self.hypotheses.temperature)
            found[pose] = self._of_scores(pose, kept, scores)
        found = found.reshape(num_poses, *chosen.shape, -1)
        found.flags.writeable = False
        return found

    def shared(self, num_outcomes: int) -> Floats32:
        """p(reference touch | shape, hypothesis) in the first pose of each group, ``(G, K, N, M)``."""
        if num_outcomes not in self._shared:
            kept = _evenly(self.references.shape[1], num_outcomes)
            tables = [self._of_group(group, pose, kept) for group, pose in enumerate(self._first_poses)]
            self._shared[num_outcomes] = np.stack(tables)
            self._shared[num_outcomes].flags.writeable = False
        return self._shared[num_outcomes]

    def _kept(self, pose: int, num_outcomes: int) -> Floats32:
        """p(reference touch | shape, hypothesis) in a pose that has references of its own, ``(K, N, M)``; kept."""
        key = pose, num_outcomes
        if key not in self._of_poses:
            self._of_poses[key] = self._of_group(pose, pose, _evenly(self.references.shape[1], num_outcomes))
        return self._of_poses[key]

    def _of_group(self, group: int, pose: int, kept: NDArray[np.int64]) -> Floats32:
        """p(reference touch | shape, hypothesis) of some references of a group, in one of its poses, ``(K, N, M)``."""
        return self._of_scores(group, kept, self.hypotheses.scores(pose, self.references[group, kept]))

    def _of_scores(self, group: int, kept: NDArray[np.int64], scores: Floats32) -> Floats32:
        """Probabilities ``(..., M)`` of references of a group from their likelihood scores ``(M, ...)``."""
        return bounded_softmax(np.ascontiguousarray(np.moveaxis(scores, 0, -1)) - self._log_normalisers[group, kept])

    @cached_property
    def _of_poses(self) -> dict[tuple[int, int], Floats32]:
        return {}

    @cached_property
    def _shared(self) -> dict[int, Floats32]:
        return {}

    @property
    def _first_poses(self) -> list[int]:
        """A pose in which the references of each group were felt, ``(G,)``."""
        groups = self.hypotheses.groups or range(len(self.references))
        return [list(groups).index(group) for group in range(len(self.references))]

    @cached_property
    def _log_normalisers(self) -> Floats32:
        """Log sum of the likelihood scores of every reference over all hypotheses, ``(G, M)``."""
        size = max(1, _AT_ONCE // math.prod(self.hypotheses.shape[1:3]))
        number = self.references.shape[1]
        blocks = np.array_split(np.arange(number), -(-number // size))
        return np.stack(
            [
                np.concatenate([log_sums(self.hypotheses.scores(pose, some[block])) for block in blocks])
                for pose, some in zip(self._first_poses, self.references, strict=True)
            ]
        )

    def sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """Touches of objects of a shape: one hypothesis for each object, then references by their ratio under it."""
        from belief.touch_batch import TouchBatch

        bodies = rng.integers(self.hypotheses.shape[2], size=len(poses))
        group_of = np.array(self.hypotheses.groups or range(self.hypotheses.shape[0]))
        drawn, groups = np.empty(poses.shape, np.int64), group_of[poses]
        for pose in np.unique(poses).tolist():
            group = group_of[pose]
            rows, steps = np.nonzero(poses == pose)
            hypotheses = self.hypotheses.in_pose(pose)[shape, bodies[rows]]
            of_body = log_ratios(self.references[group], hypotheses, self.hypotheses.temperature).T
            of_body = of_body - self._log_normalisers[group] + rng.gumbel(size=of_body.shape)
            drawn[rows, steps] = of_body.argmax(axis=1)
        return TouchBatch(poses, self.logits[groups, drawn], self.references[groups, drawn])


def _evenly(number: int, most: int) -> NDArray[np.int64]:
    """Indices of at most so many of a number of things, evenly spaced."""
    return np.linspace(0, number - 1, min(most, number)).round().astype(np.int64)
