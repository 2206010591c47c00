r"""Linear discriminant analysis as a likelihood: a Gaussian for each shape in each pose, with one covariance for all.

x | shape k, pose p ~ N(m_pk, Σ)            touches independent given the shape
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.logit_embedding import LogitEmbedding
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.quantisation import sampled_table
from belief.observation_model.variance_components import covariance
from belief.problem import Touch
from belief.touch_batch import TouchBatch
from belief.validation import Floats

_MEAN_POOLING = 30.0  # weight of a shape's mean over all poses in its mean in each pose, in touches


class PoseMeans(NamedTuple):
    """Number of touches in each pose, ``(S, P)``, and mean of their vectors, ``(S, P, D)``; zero where there are none.

    For Gaussian models whose shapes share their covariances this is all that a likelihood depends on.
    """

    counts: Floats
    means: Floats

    @classmethod
    def of(cls, vectors: Floats, poses: NDArray[np.int64], num_poses: int) -> PoseMeans:
        """The statistics of vectors ``(S, n, D)`` in poses ``(S, n)``.

        >>> found = PoseMeans.of(np.array([[[1.0], [3.0], [5.0]]]), np.array([[0, 0, 2]]), num_poses=3)
        >>> found.counts.tolist(), found.means.ravel().tolist()
        ([[2.0, 0.0, 1.0]], [2.0, 0.0, 5.0])
        """
        membership = (poses[..., None] == np.arange(num_poses)).astype(np.float64)  # (S, n, P)
        counts = membership.sum(axis=1)
        return cls(counts, np.swapaxes(membership, 1, 2) @ vectors / np.maximum(counts, 1.0)[..., None])

    def with_touch(self, vector: Floats, pose: int) -> PoseMeans:
        """The statistics of one sequence after one more touch with vector ``(D,)``."""
        counts, means = self.counts.copy(), self.means.copy()
        counts[0, pose] += 1.0
        means[0, pose] += (vector - means[0, pose]) / counts[0, pose]
        return PoseMeans(counts, means)


class PoseMeansModel(ArrayModel):
    """An observation model whose likelihood depends on touches only through their :class:`PoseMeans`.

    Attributes:
        embedding: from touches to vectors.
        means: mean vector of each shape in each pose, ``(P, K, D)``.

    Example:
        >>> touches = [Touch(0, row) for row in np.random.default_rng(0).normal(size=(50, 2))]
        >>> model: PoseMeansModel = GaussianModel.fit(touches, np.arange(50) % 2)
        >>> statistics = model.statistics_with(model.statistics_with(None, touches[0]), touches[1])
        >>> bool(np.allclose(model.log_likelihood_of(statistics), model.log_likelihood(touches[:2])))
        True
    """

    embedding: LogitEmbedding
    means: Floats

    @abstractmethod
    def log_likelihoods_of(self, found: PoseMeans) -> Floats:
        """Log p(touches | shape) up to a constant per sequence, ``(S, K)``."""

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.means)

    def require_means(self) -> None:
        """Raise ValueError unless the means are finite and ``(P, K, D)``."""
        self.to_floats("means")
        expected = (len(self.shape_labels), self.embedding.num_components)
        if self.means.ndim != 3 or self.means.shape[1:] != expected or len(self.means) == 0:
            raise ValueError(f"means must be (P, {expected[0]}, {expected[1]}), got {self.means.shape}")

    def _log_likelihoods(self, batch: TouchBatch) -> Floats:
        return self.log_likelihoods_of(PoseMeans.of(self.embedding(batch), batch.poses, self.num_poses))

    def statistics_with(self, statistics: PoseMeans | None, touch: Touch) -> PoseMeans:
        """See :class:`~belief.observation_model.evidence.Summarises`."""
        batch = self.alone(touch)
        vectors = self.embedding(batch)
        if statistics is None:
            return PoseMeans.of(vectors, batch.poses, self.num_poses)
        return statistics.with_touch(vectors[0, 0], int(batch.poses[0, 0]))

    def log_likelihood_of(self, statistics: PoseMeans) -> Floats:
        """See :class:`~belief.observation_model.evidence.Summarises`."""
        return self.log_likelihoods_of(statistics)[0]

    def _tabulate(self, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
        """See :class:`ArrayModel`; a table of single sampled touches, which does not describe repeats."""
        return sampled_table(self, num_outcomes, rng)


@dataclass(frozen=True, eq=False)
class GaussianModel(PoseMeansModel):
    """A Gaussian model of the logits, with a mean per shape and pose and one covariance.

    Attributes:
        shape_labels: names of the K shapes.
        embedding: from touches to vectors.
        means: ``(P, K, D)``.
        covariance: ``(D, D)``.

    Raises:
        ValueError: arrays that do not fit each other, or a covariance that is not positive definite.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> shapes = np.arange(600) % 3
        >>> touches = [Touch(0, row) for row in rng.normal(size=(600, 3)) + 2.0 * np.eye(3)[shapes]]
        >>> model = GaussianModel.fit(touches, shapes)
        >>> int(model.log_likelihood([Touch(0, np.array([0.0, 3.0, 0.0]))]).argmax())
        1
    """

    name: ClassVar[str] = "gaussian"

    shape_labels: tuple[str, ...]
    embedding: LogitEmbedding
    means: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        self.require_means()
        self.to_floats("covariance")
        require_covariance("covariance", self.covariance, self.embedding.num_components, definite=True)
        self.freeze()

    @classmethod
    def fit(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike | None = None,
        *,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
    ) -> GaussianModel:
        """Fit by maximum likelihood, with means shrunk towards those of all poses.

        Arguments and errors are those of :meth:`LabelledTouches.of`; ``object_ids`` has no effect.
        """
        data = LabelledTouches.of(touches, shapes, object_ids, shape_labels, num_poses)
        embedding = LogitEmbedding.fit(data.batch)
        means, rest = pose_means(embedding(data.batch)[0], data)
        return cls(data.shape_labels, embedding, means, covariance(rest))

    def log_likelihoods_of(self, found: PoseMeans) -> Floats:
        """See :class:`PoseMeansModel`."""
        away = found.means @ self._whitening.T
        shifts = away[:, :, None] - self.means @ self._whitening.T  # (S, P, K, D)
        return np.asarray(-0.5 * (found.counts[..., None] * np.square(shifts).sum(axis=3)).sum(axis=1))

    @cached_property
    def _whitening(self) -> Floats:
        """A with A Σ Aᵀ = I."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        noise = rng.standard_normal((*poses.shape, self.means.shape[2])) @ np.linalg.cholesky(self.covariance).T
        return self.embedding.to_touches(poses, self.means[poses, shape] + noise)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        arrays = {"means": self.means.tolist(), "covariance": self.covariance.tolist()}
        return {"embedding": self.embedding.to_fields(), **arrays}

    @classmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> GaussianModel:
        """See :class:`ArrayModel`."""
        means, found = (np.array(fields[name], np.float64) for name in ("means", "covariance"))
        return cls(shape_labels, LogitEmbedding.from_fields(fields["embedding"]), means, found)


def pose_means(vectors: Floats, data: LabelledTouches, pooling: float = _MEAN_POOLING) -> tuple[Floats, Floats]:
    """Mean vector of each shape in each pose, ``(P, K, D)``, and the residuals of the touches, ``(n, D)``.

    Each mean is shrunk towards the shape's mean over all poses. A shape without touches gets the mean of all touches.

    >>> data = LabelledTouches.of([Touch(pose, np.zeros(2)) for pose in (0, 0, 1)], [0, 0, 0], None)
    >>> means, rest = pose_means(np.array([[1.0], [1.0], [4.0]]), data, pooling=1.0)
    >>> means[:, 0].round(2).tolist(), rest.round(2).tolist()                # 2 is the mean over both poses
    ([[1.33], [3.0]], [[-0.33], [-0.33], [1.0]])
    """
    sums = np.zeros((data.num_poses, data.num_shapes, vectors.shape[1]))
    counts = np.zeros((data.num_poses, data.num_shapes, 1))
    np.add.at(sums, (data.poses, data.shapes), vectors)
    np.add.at(counts, (data.poses, data.shapes), 1.0)
    seen = counts.sum(axis=0)
    overall = np.where(seen > 0.0, sums.sum(axis=0) / np.maximum(seen, 1.0), vectors.mean(axis=0))
    means = (sums + pooling * overall) / (counts + pooling)
    return means, vectors - means[data.poses, data.shapes]


def require_covariance(name: str, values: Floats, size: int, *, definite: bool) -> None:
    """Check that a covariance is valid and ``(size, size)``.

    Raises:
        ValueError: wrong shape, not symmetric, or an eigenvalue below zero (not above zero, if ``definite``).

    >>> require_covariance("own", np.zeros((1, 1)), size=1, definite=True)
    Traceback (most recent call last):
    ...
    ValueError: own must be positive definite, its least eigenvalue is 0.0
    """
    if values.shape != (size, size):
        raise ValueError(f"{name} must be of shape {(size, size)}, got {values.shape}")
    scale = np.abs(values).max()
    if np.abs(values - values.T).max() > 1e-9 * scale:
        raise ValueError(f"{name} must be symmetric")
    least = float(np.linalg.eigvalsh(values)[0])
    if not (least > 0.0 if definite else least >= -1e-9 * scale):
        raise ValueError(
            f"{name} must be positive {'' if definite else 'semi'}definite, its least eigenvalue is {least}"
        )
