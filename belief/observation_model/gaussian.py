r"""A Gaussian for every shape in every pose: linear or quadratic discriminant analysis as a likelihood.

    x | shape k, pose p ~ N(m_pk, Σ_k)            touches independent given the shape

With ``pooling`` touches' worth of the covariance of all shapes together mixed into each shape's own, it goes from
quadratic (0) to linear discriminant analysis (∞), as in Friedman (1989).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.batch import TouchBatch
from belief.observation_model.embedding import Embedding, LogitEmbedding, embedding_from_fields
from belief.observation_model.model import ArrayModel, calibration_arrays, labels_or_default
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.quantisation import sampled_table
from belief.problem import Floats, Touch

MEAN_POOLING = 30.0
"""Weight of a shape's mean over all poses in that of each pose, in touches."""
_SMALLEST_VARIANCE = 1e-12  # of logits


@dataclass(frozen=True, eq=False)
class GaussianModel(ArrayModel):
    """One Gaussian a shape and pose on an embedding of touches; covariances are those of shapes, means also of poses.

    Attributes:
        shape_labels: names of the K shapes.
        embedding: where it looks at a touch.
        means: ``(P, K, D)``.
        covariances: ``(K, D, D)``.

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
    embedding: Embedding
    means: Floats
    covariances: Floats

    @classmethod
    def fit(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike | None = None,
        *,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
        embedding: Embedding | None = None,
        pooling: float = 30.0,
    ) -> GaussianModel:
        """Maximum likelihood, shrunk where touches are few.

        Args:
            touches: calibration touches, of objects the classifier was not trained on.
            shapes: true shape index of each, ``(n,)``.
            object_ids: of no effect, as this model treats touches as independent given the shape.
            shape_labels: names; by default ``shape_0`` and so on.
            num_poses: P; by default one more than the largest pose seen.
            embedding: where to look at a touch; the logits by default.
            pooling: weight of what all shapes have in common in each one's covariance, in touches; 0 for quadratic,
                ``inf`` for linear discriminant analysis.

        Raises:
            ValueError: no touches, labels out of range, or lengths that do not fit.
        """
        batch, truth, _ = calibration_arrays(touches, shapes, object_ids)
        embedding = embedding if embedding is not None else LogitEmbedding.fit(batch)
        vectors, poses = embedding(batch)[0], batch.poses[0]
        num_shapes = batch.logits.shape[2]
        means = pose_means(vectors, truth, poses, num_shapes, num_poses)
        rest = vectors - means[poses, truth]
        scatter = np.stack([rest[truth == k].T @ rest[truth == k] for k in range(num_shapes)])
        covariances = positive_definite(pooled(scatter, np.bincount(truth, minlength=num_shapes), pooling))
        return cls(labels_or_default(shape_labels, num_shapes), embedding, means, covariances)

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.means)

    def log_likelihood_batch(self, batch: TouchBatch) -> Floats:
        """See :class:`ArrayModel`; the sum over touches."""
        rest = self.embedding(batch)[:, :, None] - self.means[batch.poses]  # (S, n, K, D)
        white = np.einsum("snkd,ked->snke", rest, self._whitening)
        log_density = -0.5 * (white**2).sum(axis=-1) + self._log_determinants
        return np.asarray(log_density.sum(axis=1))

    @cached_property
    def _whitening(self) -> Floats:
        """``(K, D, D)``: W with Wᵀ W = Σ⁻¹."""
        return np.linalg.inv(np.linalg.cholesky(self.covariances))

    @cached_property
    def _log_determinants(self) -> Floats:
        return np.asarray(np.log(np.diagonal(self._whitening, axis1=1, axis2=2)).sum(axis=1))

    def sample_batch(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`."""
        noise = rng.standard_normal((*poses.shape, self.means.shape[2])) @ np.linalg.cholesky(self.covariances[shape]).T
        return TouchBatch(poses, self.embedding.to_logits(self.means[poses, shape] + noise))

    def outcome_table(self, num_outcomes: int | None = None, rng: np.random.Generator | None = None) -> OutcomeTable:
        """See :class:`ArrayModel`; from touches that the model samples."""
        return sampled_table(self, num_outcomes, rng)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        arrays = {"means": self.means.tolist(), "covariances": self.covariances.tolist()}
        return {"embedding": self.embedding.to_fields(), **arrays}

    @classmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> GaussianModel:
        """See :class:`ArrayModel`."""
        arrays = (np.array(fields[name], np.float64) for name in ("means", "covariances"))
        return cls(shape_labels, embedding_from_fields(fields["embedding"]), *arrays)


def pose_means(
    vectors: Floats,
    shapes: NDArray[np.int64],
    poses: NDArray[np.int64],
    num_shapes: int,
    num_poses: int | None,
    pooling: float = MEAN_POOLING,
) -> Floats:
    """Mean vector of each shape in each pose, ``(P, K, D)``, shrunk towards the shape's mean over all poses.

    A shape without touches gets the mean of all: it then explains every touch equally badly.

    Raises:
        ValueError: a pose beyond ``num_poses``.
    """
    num_poses = int(poses.max()) + 1 if num_poses is None else num_poses
    if poses.max() >= num_poses:
        raise ValueError(f"touch {poses.argmax()} has pose {poses.max()}, num_poses is {num_poses}")
    sums = np.zeros((num_poses, num_shapes, vectors.shape[1]))
    counts = np.zeros((num_poses, num_shapes, 1))
    np.add.at(sums, (poses, shapes), vectors)
    np.add.at(counts, (poses, shapes), 1.0)
    seen = counts.sum(axis=0)
    overall = np.where(seen > 0.0, sums.sum(axis=0) / np.maximum(seen, 1.0), vectors.mean(axis=0))
    return (sums + pooling * overall) / (counts + pooling)


def pooled(sums: Floats, numbers: ArrayLike, pooling: float) -> Floats:
    """Covariances ``(K, D, D)`` from sums of squares, each shrunk towards that of all shapes together.

    Args:
        sums: sums of squares, ``(K, D, D)``.
        numbers: how many terms each has, ``(K,)``; none at all for a shape that was never seen.
        pooling: weight of the common covariance, in terms, ≥ 0; ``inf`` for that one only.

    Raises:
        ValueError: ``pooling`` is negative or NaN.
    """
    if not pooling >= 0.0:
        raise ValueError(f"pooling must be ≥ 0, got {pooling}")
    number = np.asarray(numbers, np.float64)[:, None, None]
    common = sums.sum(axis=0) / max(number.sum(), 1.0)
    if np.isinf(pooling):
        return np.broadcast_to(common, sums.shape).copy()
    weight = np.where(number > 0.0, pooling, 1.0)  # a shape never seen has nothing but what is common
    return np.asarray((sums + weight * common) / (number + weight))


def positive_definite(covariances: Floats) -> Floats:
    """Covariances ``(K, D, D)`` with eigenvalues of at least 1e-6 of the largest, so that none is singular."""
    values, basis = np.linalg.eigh((covariances + np.swapaxes(covariances, 1, 2)) / 2)
    values = np.maximum(values, np.maximum(1e-6 * values[:, -1:], _SMALLEST_VARIANCE))
    return np.asarray((basis * values[:, None]) @ np.swapaxes(basis, 1, 2))
