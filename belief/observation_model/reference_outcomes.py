"""Outcomes of the joint observation model: touches that stand for all, and how probable each is under a hypothesis.

A learned ratio has no density over images, so the next touch is supposed to be one of some reference touches:
p(reference | hypothesis) is proportional to its ratio under that hypothesis, over its mean ratio under all.

One pose, one shape, two hypotheses, two references of which each fits one of them:

>>> from belief.observation_model.embedded_hypotheses import FixedHypotheses
>>> table = np.array([[[[3.0, 0.0], [0.0, 3.0]]]], np.float32)
>>> hypotheses = EmbeddedHypotheses(FixedHypotheses(table), (1, 1, 2, 2), (), temperature=1.0)
>>> outcomes = ReferenceOutcomes(hypotheses, references=np.eye(2)[None], logits=np.zeros((1, 2, 1)))
>>> outcomes.of(np.array([[0, 1]]), num_outcomes=2).astype(float).round(2).tolist()
[[[[0.95, 0.05], [0.05, 0.95]]]]
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from belief.observation_model.embedded_hypotheses import EmbeddedHypotheses, Floats32, log_ratios
from belief.observation_model.log_weights import bounded_softmax, log_sums
from belief.touch_batch import TouchBatch
from belief.validation import Floats

_AT_ONCE = 1 << 22  # numbers, of log weights that are worked on at a time
_MOST_OUTCOMES = 1 << 25  # numbers, of probabilities of outcomes under all hypotheses that are kept, pose by pose


@dataclass(frozen=True, eq=False)
class ReferenceOutcomes:
    """Reference touches as outcomes of the next touch; what is computed once is kept.

    Attributes:
        hypotheses: of the body.
        references: embeddings of M touches of each pose or group of poses, ``(G, M, D)``.
        logits: the shape logits of these, ``(G, M, K)``.
    """

    hypotheses: EmbeddedHypotheses
    references: Floats
    logits: Floats

    def of(self, chosen: NDArray[np.int64], num_outcomes: int) -> Floats32:
        """p(reference touch | pose, hypothesis), over reference touches of the pose, ``(P, K, H, M)``.

        Args:
            chosen: index of H hypotheses of each shape, ``(K, H)``.
            num_outcomes: M, evenly spaced among the references, or all if there are fewer.
        """
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
