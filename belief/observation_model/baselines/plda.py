r"""Probabilistic linear discriminant analysis (PLDA) with poses: touches of one object share random effects.

A touch of object o, of shape k, in pose p is (Ioffe 2006; Brümmer & de Villiers 2010; Sizov, Lee & Kinnunen 2014)

    x = m_pk + u_o + v_op + e,     u ~ N(0, B_k),  v ~ N(0, V_k),  e ~ N(0, W_k).

All touches of the object share u, its touches in one pose share v, and e is independent for each touch. With B = V = 0
it is the Gaussian model. The likelihood has a closed form in the number of touches in each pose, their mean and their
scatter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
import scipy  # whose parts load at first use
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
from belief.observation_model.baselines.variance_components import Components, estimate_components
from belief.observation_model.calibration_data import LabelledTouches
from belief.problem import Floats, Touch
from belief.touch_batch import TouchBatch
from belief.validation import as_real, require_choice

Status: TypeAlias = Literal["ok", "no_repeats", "one_touch_per_object"]


@dataclass(frozen=True, eq=False)
class PLDAModel(PoseStatisticsModel):
    """A Gaussian model with one random effect per object and one per object and pose.

    Attributes:
        shape_labels: names of the K shapes.
        embedding: from touches to vectors.
        means: ``(P, K, D)``.
        components: the covariances B, V and W.
        status: ``ok``; ``no_repeats``: no object was touched twice in a pose, and V = W is assumed;
            ``one_touch_per_object``: B = V = W is assumed.

    Raises:
        ValueError: arrays that do not fit each other, invalid covariances, or an unknown status.

    Example:
        Five equal touches of one object in one pose are little more evidence than one:

        >>> rng = np.random.default_rng(0)
        >>> ids = np.arange(1200) // 4                                  # four touches of each object, in one pose
        >>> shapes = ids % 2
        >>> shared = rng.normal(size=(300, 2))[ids]                     # equal in all four
        >>> logits = 1.5 * np.eye(2)[shapes] + shared + 0.1 * rng.normal(size=(1200, 2))
        >>> touches = [Touch(0, row) for row in logits]
        >>> model = PLDAModel.fit(touches, shapes, ids)
        >>> touch = Touch(0, np.array([1.5, 0.0]))
        >>> once, five = (np.ptp(model.log_likelihood([touch] * n)) for n in (1, 5))
        >>> bool(once <= five < 1.1 * once)
        True
    """

    name: ClassVar[str] = "plda"

    shape_labels: tuple[str, ...]
    embedding: Embedding
    means: Floats
    components: Components
    status: Status = "ok"

    def __post_init__(self) -> None:
        object.__setattr__(self, "means", np.asarray(as_real(self.means, "means"), np.float64))
        parts = (np.asarray(as_real(part, name), np.float64) for name, part in self.components._asdict().items())
        object.__setattr__(self, "components", Components(*parts))
        require_means(self.means, len(self.shape_labels), self.embedding.num_components)
        for name, part in self.components._asdict().items():
            require_covariances(name, part, self.means, definite=name == "of_touch")
        require_choice("status", self.status, get_args(Status))
        self.freeze()

    @classmethod
    def fit(
        cls,
        touches: Sequence[Touch],
        shapes: ArrayLike,
        object_ids: ArrayLike,
        *,
        shape_labels: Sequence[str] | None = None,
        num_poses: int | None = None,
        embedding: Embedding | None = None,
        pooling: float = np.inf,
    ) -> PLDAModel:
        """Fit the means as :class:`GaussianModel` does, and the covariances by expectation maximisation.

        ``pooling`` ≥ 0 is the weight of the common covariances in those of each shape, in terms of their sums; by
        default all shapes have the same covariances. The default embedding is that of the logits. Other arguments and
        errors are those of :meth:`LabelledTouches.of`; some objects should be touched several times in one pose.
        """
        data = LabelledTouches.of(touches, shapes, object_ids, shape_labels, num_poses)
        embedding = embedding if embedding is not None else LogitEmbedding.fit(data.batch)
        means, rest = pose_means(embedding(data.batch)[0], data)
        total = positive_definite(pooled(scatter_of_shapes(rest, data), data.counts, pooling))
        has_repeats = np.unique(data.objects * data.num_poses + data.poses).size < len(data.poses)
        status: Status = "ok" if has_repeats else "no_repeats"
        if data.num_objects == len(data.poses):
            status, components = "one_touch_per_object", Components(total / 3, total / 3, total / 3)
        else:
            components = estimate_components(rest, data, total, pooling, has_repeats=has_repeats)
        return cls(data.shape_labels, embedding, means, components, status)

    @property
    def repeat_correlation(self) -> float:
        """The correlation ρ that gives a repeat the same information about the shape as in this model.

        The mean of two touches has covariance B + V + W/2 in one pose and B + (V + W)/2 in two. Its information about
        the shape is tr(covariance⁻¹ · scatter of the means between shapes). Under correlation ρ a repeat adds
        (1 - ρ)/(1 + ρ) times the information of a touch in another pose.

        >>> from belief.observation_model import LogitEmbedding
        >>> identity, means = np.stack([np.eye(2)] * 3), np.array([[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]])
        >>> embedding = LogitEmbedding(np.full(3, -9.0), np.full(3, 9.0))
        >>> parts = Components(0 * identity, 0.3 * identity, 0.7 * identity)
        >>> round(PLDAModel(("a", "b", "c"), embedding, means, parts).repeat_correlation, 6)
        0.3
        """
        offsets = self.means - self.means.mean(axis=1, keepdims=True)  # (P, K, D)
        scatter = np.einsum("pkd,pke->de", offsets, offsets)
        shared, repeated, rest = (part.mean(axis=0) for part in self.components)

        def information(covariance: Floats) -> float:
            return float(np.trace(np.linalg.solve(covariance, scatter)))

        once = information(shared + repeated + rest)
        repeat = information(shared + repeated + rest / 2.0) - once
        another = information(shared + (repeated + rest) / 2.0) - once
        if another <= 0.0:  # all shapes have the same mean
            return 0.0
        ratio = min(max(repeat / another, 0.0), 1.0)
        return (1.0 - ratio) / (1.0 + ratio)

    def _log_likelihoods_of(self, found: PoseStatistics) -> Floats:
        """Log-likelihoods ``(S, K)``."""
        basis, counts, present = self._basis, found.counts, np.maximum(found.counts, 1.0)  # (S, p)
        within = squares_within(found.scatter, basis.whiten)
        # In the basis of a shape W is the identity, V is diagonal, and the mean in a pose has variance V + 1 / count.
        y = whitened(found.means, basis.whiten) - basis.means[found.used]  # (S, p, K, D)
        weight = np.where(counts > 0.0, 1.0, 0.0)[..., None, None] / (basis.of_pose + 1.0 / present[..., None, None])
        between = (weight * y**2).sum(axis=(1, 3))
        pull = (weight * y).sum(axis=1)  # (S, K, D)
        # The other terms depend only on the pattern of counts, and few patterns occur.
        _, example, pattern = np.unique(np.sort(counts, axis=1), axis=0, return_index=True, return_inverse=True)
        inner = np.eye(y.shape[3]) + basis.of_object * weight[example].sum(axis=1)[..., None, :]  # I + B M, M diagonal
        gain = np.linalg.solve(inner, np.broadcast_to(basis.of_object, inner.shape))  # (patterns, K, D, D)
        log_det = np.linalg.slogdet(inner)[1] + np.log1p(counts[example][..., None, None] * basis.of_pose).sum(
            axis=(1, 3)
        )
        explained, pattern = np.empty((len(y), y.shape[2])), pattern.ravel()
        for i, of_pattern in enumerate(gain):
            some = np.swapaxes(pull[pattern == i], 0, 1)  # (K, s, D)
            explained[pattern == i] = ((some @ of_pattern) * some).sum(axis=2).T
        return counts.sum(axis=1)[:, None] * basis.log_scale - 0.5 * (within + between - explained + log_det[pattern])

    @cached_property
    def _basis(self) -> _Basis:
        pairs = zip(self.components.of_pose, self.components.of_touch, strict=True)
        values, vectors = (np.stack(parts) for parts in zip(*(scipy.linalg.eigh(*pair) for pair in pairs), strict=True))
        whiten = np.swapaxes(vectors, 1, 2)
        return _Basis(
            whiten,
            np.linalg.slogdet(whiten)[1],
            np.einsum("ked,pkd->pke", whiten, self.means),
            np.maximum(values, 0.0),
            whiten @ self.components.of_object @ vectors,
        )

    def _sample(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        num_sequences, n = poses.shape
        size = self.means.shape[2]
        used, index = np.unique(poses, return_inverse=True)
        of_object, of_pose, of_touch = (_root(part[shape]) for part in self.components)
        shared = rng.standard_normal((num_sequences, 1, size)) @ of_object
        in_pose = rng.standard_normal((num_sequences, len(used), size)) @ of_pose
        alone = rng.standard_normal((num_sequences, n, size)) @ of_touch
        rows = np.arange(num_sequences)[:, None]
        return self.embedding.to_touches(
            poses, self.means[poses, shape] + shared + in_pose[rows, index.reshape(poses.shape)] + alone
        )

    def to_fields(self) -> dict[str, Any]:
        """See :class:`ArrayModel`."""
        components = {name: part.tolist() for name, part in self.components._asdict().items()}
        means = self.means.tolist()
        return {"status": self.status, "embedding": self.embedding.to_fields(), "means": means, **components}

    @classmethod
    def from_fields(cls, shape_labels: tuple[str, ...], fields: Mapping[str, Any]) -> PLDAModel:
        """See :class:`ArrayModel`."""
        means, *parts = (np.array(fields[name], np.float64) for name in ("means", *Components._fields))
        embedding = embedding_from_fields(fields["embedding"])
        return cls(shape_labels, embedding, means, Components(*parts), fields["status"])


class _Basis(NamedTuple):
    """A basis for each shape in which W is the identity and V is diagonal.

    Attributes:
        whiten: A with A W Aᵀ = I, ``(K, D, D)``.
        log_scale: log |det A|, ``(K,)``.
        means: A m, ``(P, K, D)``.
        of_pose: the diagonal of A V Aᵀ, ``(K, D)``.
        of_object: A B Aᵀ, ``(K, D, D)``.
    """

    whiten: Floats
    log_scale: Floats
    means: Floats
    of_pose: Floats
    of_object: Floats


def _root(covariance: Floats) -> Floats:
    """A symmetric square root, also of a singular covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
