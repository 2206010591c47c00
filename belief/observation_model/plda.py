r"""Touches of one object resemble each other: the two-covariance model of speaker verification, with poses.

A touch of object o, of shape k, in pose p is (Ioffe 2006; Brümmer & de Villiers 2010; Sizov, Lee & Kinnunen 2014)

    x = m_pk + u_o + v_op + e,     u ~ N(0, B_k),  v ~ N(0, V_k),  e ~ N(0, W_k):

u is what all touches of the object share, v what those in one pose share, e what every touch has for itself. Under
naive Bayes the same pose felt twice counts twice; here its second touch only averages out e. With B = V = 0 the two
are the same. The likelihood of all touches is closed-form and needs of each pose no more than the number of touches,
their mean and their scatter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh

from belief.batch import TouchBatch
from belief.observation_model.embedding import Embedding, LogitEmbedding, embedding_from_fields
from belief.observation_model.gaussian import pooled, pose_means, positive_definite
from belief.observation_model.model import ArrayModel, calibration_arrays, labels_or_default
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.quantisation import sampled_table
from belief.observation_model.variance_components import Components, estimate_components
from belief.problem import Floats, Touch

Status: TypeAlias = Literal["ok", "no_repeats", "one_touch_per_object"]


@dataclass(frozen=True, eq=False)
class PLDAModel(ArrayModel):
    """Gaussian touches that share a part with other touches of their object, and another with those in their pose.

    Attributes:
        shape_labels: names of the K shapes.
        embedding: where it looks at a touch.
        means: ``(P, K, D)``.
        components: covariances of what an object's touches share, of what those in one pose share, and of the rest.
        status: ``ok``; ``no_repeats``: no object was touched twice in a pose, so half of what a pose's touches do not
            share with others is *taken* to repeat; ``one_touch_per_object``: nor in two poses, and a third each is
            taken for B, V and W.

    Example:
        Five touches of one object in one pose, all the same, are hardly more than one:

        >>> rng = np.random.default_rng(0)
        >>> ids = np.arange(1200) // 4                                  # four touches of each object, in one pose
        >>> shapes = ids % 2
        >>> shared = rng.normal(size=(300, 2))[ids]                     # what repeats
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
        """Means as of :class:`GaussianModel`; covariances by expectation maximisation.

        Args:
            touches: calibration touches, of objects the classifier was not trained on; touch some of them several
                times in one pose, or the model cannot know how far touches repeat each other (see ``status``).
            shapes: true shape index of each, ``(n,)``.
            object_ids: which object was touched, ``(n,)``; any labels.
            shape_labels: names; by default ``shape_0`` and so on.
            num_poses: P; by default one more than the largest pose seen.
            embedding: where to look at a touch; the logits by default.
            pooling: weight of what all shapes have in common in each one's covariances, in terms of the sums they are
                estimated from; by default there is one set of covariances for all shapes.

        Raises:
            ValueError: no touches, labels out of range, or lengths that do not fit.
        """
        batch, truth, objects = calibration_arrays(touches, shapes, object_ids)
        embedding = embedding if embedding is not None else LogitEmbedding.fit(batch)
        vectors, poses, num_shapes = embedding(batch)[0], batch.poses[0], batch.logits.shape[2]
        means = pose_means(vectors, truth, poses, num_shapes, num_poses)
        rest = vectors - means[poses, truth]
        scatter = np.stack([rest[truth == k].T @ rest[truth == k] for k in range(num_shapes)])
        total = positive_definite(pooled(scatter, np.bincount(truth, minlength=num_shapes), pooling))
        num_pairs, num_objects = np.unique(objects * len(means) + poses).size, int(objects.max()) + 1
        status: Status = "ok" if num_pairs < len(poses) else "no_repeats"
        if num_objects == len(poses):
            status, components = "one_touch_per_object", Components(total / 3, total / 3, total / 3)
        else:
            components = estimate_components(rest, truth, objects, poses, total, pooling, has_repeats=status == "ok")
        return cls(labels_or_default(shape_labels, num_shapes), embedding, means, components, status)

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.means)

    def log_likelihood_batch(self, batch: TouchBatch) -> Floats:
        """See :class:`ArrayModel`."""
        vectors, (num_sequences, n) = self.embedding(batch), batch.poses.shape
        used, poses = np.unique(batch.poses, return_inverse=True)
        membership = (poses.reshape(num_sequences, n)[..., None] == np.arange(len(used))).astype(float)  # (S, n, p)
        counts = membership.sum(axis=1)  # (S, p)
        means = np.einsum("snp,snd->spd", membership, vectors) / np.maximum(counts, 1.0)[..., None]
        spread = vectors - np.einsum("snp,spd->snd", membership, means)  # of touches about their pose's mean
        shifts = means[:, :, None] - self.means[used]  # (S, p, K, D), zero weight where there is no touch
        found = np.empty((num_sequences, len(self.shape_labels)))
        for k, (whiten, log_scale, shared_pose, shared_object) in enumerate(self._bases):
            # In this basis W is the identity, V is diagonal, and each pose's mean has variance V + 1 / count.
            within = ((spread @ whiten.T) ** 2).sum(axis=(1, 2))
            y = shifts[:, :, k] @ whiten.T  # (S, p, D)
            weight = np.where(counts[..., None] > 0.0, 1.0, 0.0) / (
                shared_pose + 1.0 / np.maximum(counts, 1.0)[..., None]
            )
            between = (weight * y**2).sum(axis=(1, 2))
            precision, pull = weight.sum(axis=1), (weight * y).sum(axis=1)  # (S, D)
            inner = np.eye(len(whiten)) + shared_object * precision[:, None, :]  # I + B M, M diagonal
            gain = np.einsum("sd,sd->s", pull, np.linalg.solve(inner, (pull @ shared_object)[..., None])[..., 0])
            log_det = np.log1p(counts[..., None] * shared_pose).sum(axis=(1, 2)) + np.linalg.slogdet(inner)[1]
            found[:, k] = -0.5 * (within + between - gain + log_det) + n * log_scale
        return found

    @cached_property
    def _bases(self) -> list[tuple[Floats, float, Floats, Floats]]:
        """For each shape: A with A W Aᵀ = I and A V Aᵀ diagonal, log |det A|, that diagonal, and A B Aᵀ."""
        bases = []
        for shared_object, shared_pose, own in zip(*self.components, strict=True):
            values, vectors = eigh(shared_pose, own)
            whiten = vectors.T
            bases.append(
                (
                    whiten,
                    float(np.linalg.slogdet(whiten)[1]),
                    np.maximum(values, 0.0),
                    whiten @ shared_object @ whiten.T,
                )
            )
        return bases

    def sample_batch(self, shape: int, poses: NDArray[np.int64], rng: np.random.Generator) -> TouchBatch:
        """See :class:`ArrayModel`."""
        num_sequences, n = poses.shape
        size = self.means.shape[2]
        shared_object, shared_pose, own = (_root(part[shape]) for part in self.components)
        of_object = rng.standard_normal((num_sequences, 1, size)) @ shared_object
        of_pose = rng.standard_normal((num_sequences, self.num_poses, size)) @ shared_pose
        alone = rng.standard_normal((num_sequences, n, size)) @ own
        rows = np.arange(num_sequences)[:, None]
        return TouchBatch(
            poses, self.embedding.to_logits(self.means[poses, shape] + of_object + of_pose[rows, poses] + alone)
        )

    def outcome_table(self, num_outcomes: int | None = None, rng: np.random.Generator | None = None) -> OutcomeTable:
        """See :class:`ArrayModel`; from touches that the model samples. A table cannot say how far touches repeat."""
        return sampled_table(self, num_outcomes, rng)

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


def _root(covariance: Floats) -> Floats:
    """A symmetric square root, also of a covariance of less than full rank."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
