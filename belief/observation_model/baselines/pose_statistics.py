"""Base class of the Gaussian observation models, which need only each pose's count, mean and scatter of touches."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from belief.observation_model.baselines.embedding import Embedding
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.quantisation import sampled_table
from belief.problem import Floats, Touch
from belief.touch_batch import TouchBatch


class PoseStatistics(NamedTuple):
    """Sufficient statistics of S sequences of touches for a Gaussian model.

    Attributes:
        used: the p poses that occur in any sequence, ascending.
        counts: number of touches in each of these poses, ``(S, p)``.
        means: mean vector of these touches, ``(S, p, D)``; zero where there are none.
        scatter: sums of squares about the means, over all touches of a sequence, ``(S, D, D)``.
    """

    used: NDArray[np.int64]
    counts: Floats
    means: Floats
    scatter: Floats

    @classmethod
    def of(cls, vectors: Floats, poses: NDArray[np.int64]) -> PoseStatistics:
        """The statistics of vectors ``(S, n, D)`` in poses ``(S, n)``.

        >>> found = PoseStatistics.of(np.array([[[1.0], [3.0], [5.0]]]), np.array([[4, 4, 7]]))
        >>> found.used.tolist(), found.counts.tolist(), found.means.ravel().tolist(), found.scatter.tolist()
        ([4, 7], [[2.0, 1.0]], [2.0, 5.0], [[[2.0]]])
        """
        used, index = np.unique(poses, return_inverse=True)
        index = index.reshape(poses.shape)
        membership = (index[..., None] == np.arange(len(used))).astype(np.float64)  # (S, n, p)
        counts = membership.sum(axis=1)
        means = np.swapaxes(membership, 1, 2) @ vectors / np.maximum(counts, 1.0)[..., None]
        spread = vectors - means[np.arange(len(poses))[:, None], index]
        return cls(used, counts, means, np.swapaxes(spread, 1, 2) @ spread)

    def with_touch(self, vector: Floats, pose: int) -> PoseStatistics:
        """The statistics of one sequence after one more touch with vector ``(D,)``.

        >>> found = PoseStatistics.of(np.array([[[1.0], [3.0]]]), np.array([[4, 4]])).with_touch(np.array([5.0]), 7)
        >>> found.used.tolist(), found.counts.tolist(), found.means.ravel().tolist(), found.scatter.tolist()
        ([4, 7], [[2.0, 1.0]], [2.0, 5.0], [[[2.0]]])
        """
        used, counts, means, place = self.used, self.counts, self.means, int(np.searchsorted(self.used, pose))
        if place == len(used) or used[place] != pose:
            used, counts = np.insert(used, place, pose), np.insert(counts, place, 0.0, axis=1)
            means = np.insert(means, place, 0.0, axis=1)
        counts, means = counts.copy(), means.copy()
        counts[0, place] += 1.0
        away, number = vector - means[0, place], counts[0, place]
        means[0, place] += away / number
        return PoseStatistics(used, counts, means, self.scatter + (1.0 - 1.0 / number) * np.outer(away, away))


class PoseStatisticsModel(ArrayModel):
    """An observation model whose likelihood depends on touches only through their :class:`PoseStatistics`.

    Attributes:
        embedding: from touches to vectors.
        means: mean vector of each shape in each pose, ``(P, K, D)``.

    Example:
        >>> from belief.observation_model import GaussianModel
        >>> touches = [Touch(0, row) for row in np.random.default_rng(0).normal(size=(50, 2))]
        >>> model = GaussianModel.fit(touches, np.arange(50) % 2)
        >>> statistics = model.statistics_with(model.statistics_with(None, touches[0]), touches[1])
        >>> bool(np.allclose(model.log_likelihood_of(statistics), model.log_likelihood(touches[:2])))
        True
    """

    embedding: Embedding
    means: Floats

    @abstractmethod
    def _log_likelihoods_of(self, found: PoseStatistics) -> Floats:
        """Log p(touches | shape) up to a constant, ``(S, K)``."""

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.means)

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        return self._log_likelihoods_of(PoseStatistics.of(self.embedding(batch), batch.poses))

    def statistics_with(self, statistics: PoseStatistics | None, touch: Touch) -> PoseStatistics:
        """See :class:`~belief.observation_model.evidence.Summarises`."""
        batch = self.alone(touch)
        vectors = self.embedding(batch)
        if statistics is None:
            return PoseStatistics.of(vectors, batch.poses)
        return statistics.with_touch(vectors[0, 0], int(batch.poses[0, 0]))

    def log_likelihood_of(self, statistics: PoseStatistics) -> Floats:
        """See :class:`~belief.observation_model.evidence.Summarises`."""
        return self._log_likelihoods_of(statistics)[0]

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; a table of single sampled touches, which does not describe repeats."""
        return sampled_table(self, num_outcomes, rng)
