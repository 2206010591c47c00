r"""Linear or quadratic discriminant analysis as a likelihood: a Gaussian for each shape in each pose.

    x | shape k, pose p ~ N(m_pk, Σ_k)            touches independent given the shape

Each covariance is shrunk towards the covariance of all shapes together with weight ``pooling``, in touches: 0 gives
quadratic and ∞ linear discriminant analysis (Friedman 1989).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.observation_model.baselines.covariances import (
    pooled,
    pose_means,
    positive_definite,
    require_covariances,
    require_means,
    scatter_of_shapes,
    squares_within,
    whitened,
)
from belief.observation_model.baselines.embedding import Embedding, LogitEmbedding, embedding_from_fields
from belief.observation_model.baselines.pose_statistics import PoseStatistics, PoseStatisticsModel
from belief.observation_model.calibration_data import LabelledTouches
from belief.problem import Floats, Touch
from belief.touch_batch import TouchBatch
from belief.validation import as_real


@dataclass(frozen=True, eq=False)
class GaussianModel(PoseStatisticsModel):
    """A Gaussian model of an embedding of touches, with a mean per shape and pose and a covariance per shape.

    Attributes:
        shape_labels: names of the K shapes.
        embedding: from touches to vectors.
        means: ``(P, K, D)``.
        covariances: ``(K, D, D)``.

    Raises:
        ValueError: arrays that do not fit each other, or covariances that are not positive definite.

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

    def __post_init__(self) -> None:
        for name in ("means", "covariances"):
            object.__setattr__(self, name, np.asarray(as_real(getattr(self, name), name), np.float64))
        require_means(self.means, len(self.shape_labels), self.embedding.num_components)
        require_covariances("covariances", self.covariances, self.means, definite=True)
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
        embedding: Embedding | None = None,
        pooling: float = 30.0,
    ) -> GaussianModel:
        """Fit by maximum likelihood with shrinkage.

        ``pooling`` ≥ 0 is the weight of the common covariance in that of each shape, in touches. The default embedding
        is that of the logits. Other arguments and errors are those of :meth:`LabelledTouches.of`; ``object_ids`` has no
        effect.
        """
        data = LabelledTouches.of(touches, shapes, object_ids, shape_labels, num_poses)
        embedding = embedding if embedding is not None else LogitEmbedding.fit(data.batch)
        means, rest = pose_means(embedding(data.batch)[0], data)
        covariances = positive_definite(pooled(scatter_of_shapes(rest, data), data.counts, pooling))
        return cls(data.shape_labels, embedding, means, covariances)

    def _log_likelihoods_of(self, found: PoseStatistics) -> Floats:
        """Log-likelihoods ``(S, K)``."""
        shifts = whitened(found.means, self._whitening) - self._white_means[found.used]  # (S, p, K, D)
        squares = np.einsum("sp,spkd,spkd->sk", found.counts, shifts, shifts)
        squares += squares_within(found.scatter, self._whitening)
        return found.counts.sum(axis=1)[:, None] * self._log_determinants - 0.5 * squares

    @cached_property
    def _whitening(self) -> Floats:
        """A with Aᵀ A = Σ⁻¹, ``(K, D, D)``."""
        return np.linalg.inv(np.linalg.cholesky(self.covariances))

    @cached_property
    def _white_means(self) -> Floats:
        return np.einsum("ked,pkd->pke", self._whitening, self.means)

    @cached_property
    def _log_determinants(self) -> Floats:
        return np.asarray(np.log(np.diagonal(self._whitening, axis1=1, axis2=2)).sum(axis=1))

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        noise = rng.standard_normal((*poses.shape, self.means.shape[2])) @ np.linalg.cholesky(self.covariances[shape]).T
        return self.embedding.to_touches(poses, self.means[poses, shape] + noise)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        arrays = {"means": self.means.tolist(), "covariances": self.covariances.tolist()}
        return {"embedding": self.embedding.to_fields(), **arrays}

    @classmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> GaussianModel:
        """See :class:`ArrayModel`."""
        arrays = (np.array(fields[name], np.float64) for name in ("means", "covariances"))
        return cls(shape_labels, embedding_from_fields(fields["embedding"]), *arrays)
