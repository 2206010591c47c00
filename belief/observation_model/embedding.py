"""Where Gaussian models look at a touch: a few numbers that say what the classifier saw."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import helmert

from belief.batch import TouchBatch
from belief.problem import Floats


class Embedding(Protocol):
    """Turns touches into vectors, and vectors into touches."""

    def __call__(self, batch: TouchBatch) -> Floats:
        """Vectors ``(S, n, D)`` of touches."""

    def to_logits(self, vectors: Floats) -> Floats:
        """Logits ``(..., K)`` that such vectors ``(..., D)`` come with."""

    def to_fields(self) -> dict[str, Any]:
        """All attributes, as JSON types; :func:`embedding_from_fields` reads them."""


@dataclass(frozen=True, eq=False)
class LogitEmbedding:
    """The logits without their mean, which no softmax feels: K - 1 numbers in an orthonormal basis.

    Vectors are cut off at the extremes that the calibration touches showed, so that one touch beyond all experience
    (or a logit of 1e308) never outweighs the others.

    Attributes:
        lowest, highest: of every component, ``(K - 1,)``.

    Example:
        >>> batch = TouchBatch(np.zeros((1, 2), int), np.array([[[2.0, 0.0], [1e308, 0.0]]]))
        >>> LogitEmbedding(np.array([-3.0]), np.array([3.0]))(batch).round(3).ravel()
        array([1.414, 3.   ])
    """

    lowest: Floats
    highest: Floats

    @classmethod
    def fit(cls, batch: TouchBatch) -> LogitEmbedding:
        """With the extremes of these touches."""
        num_shapes = batch.logits.shape[2]
        if num_shapes < 2:
            raise ValueError("a Gaussian model needs logits of at least two shapes, got one")
        unbounded = np.full(num_shapes - 1, np.inf)
        vectors = cls(-unbounded, unbounded)(batch).reshape(-1, num_shapes - 1)
        return cls(vectors.min(axis=0), vectors.max(axis=0))

    def __call__(self, batch: TouchBatch) -> Floats:
        """See :class:`Embedding`."""
        z = np.clip(batch.logits, -_LARGEST, _LARGEST)
        return np.clip(z @ helmert(z.shape[2]).T, self.lowest, self.highest)

    def to_logits(self, vectors: Floats) -> Floats:
        """See :class:`Embedding`; the logits' mean is zero."""
        return vectors @ helmert(vectors.shape[-1] + 1)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`Embedding`."""
        return _arrays_to_fields(self)


@dataclass(frozen=True, eq=False)
class FeatureEmbedding:
    """The leading principal components of the classifier's features, cut off as those of :class:`LogitEmbedding`.

    Attributes:
        centre: mean of the features, ``(F,)``.
        components: orthonormal rows ``(D, F)``.
        lowest, highest: of every component, ``(D,)``.
        readout: from components to logits, the last layer as far as they span it, ``(D, K)``.
        offset: logits at the centre, ``(K,)``.
    """

    centre: Floats
    components: Floats
    lowest: Floats
    highest: Floats
    readout: Floats
    offset: Floats

    @classmethod
    def fit(cls, batch: TouchBatch, num_components: int) -> FeatureEmbedding:
        """Principal components of these touches.

        Raises:
            ValueError: the touches have no features, or not so many as components are asked for.
        """
        features = _features(batch).reshape(-1, _features(batch).shape[2])
        if not 1 <= num_components <= min(features.shape):
            raise ValueError(f"need between 1 and {min(features.shape)} components, got {num_components}")
        centre = features.mean(axis=0)
        _, components = np.linalg.eigh(np.cov(features, rowvar=False).reshape(features.shape[1], -1))
        components = components[:, ::-1][:, :num_components].T
        vectors = (features - centre) @ components.T
        logits = batch.logits.reshape(len(vectors), -1)
        design = np.column_stack([vectors, np.ones(len(vectors))])
        readout = np.linalg.lstsq(design, logits, rcond=None)[0]
        return cls(centre, components, vectors.min(axis=0), vectors.max(axis=0), readout[:-1], readout[-1])

    def __call__(self, batch: TouchBatch) -> Floats:
        """See :class:`Embedding`."""
        features = np.clip(_features(batch), -_LARGEST, _LARGEST)
        return np.clip((features - self.centre) @ self.components.T, self.lowest, self.highest)

    def to_logits(self, vectors: Floats) -> Floats:
        """See :class:`Embedding`; as the classifier's last layer would, from these components alone."""
        return vectors @ self.readout + self.offset

    def to_fields(self) -> dict[str, Any]:
        """See :class:`Embedding`."""
        return _arrays_to_fields(self)


_LARGEST = 1e300  # sums and differences of a few hundred such numbers are finite


def _features(batch: TouchBatch) -> NDArray[np.float64]:
    if batch.features is None:
        raise ValueError("the touches carry no features; use an embedding of logits, or keep the features")
    return np.asarray(batch.features, np.float64)


def embedding_from_fields(fields: Mapping[str, Any]) -> LogitEmbedding | FeatureEmbedding:
    """The embedding that wrote these fields.

    Raises:
        ValueError: there is no such embedding.
    """
    for kind in (LogitEmbedding, FeatureEmbedding):
        if fields["embedding"] == kind.__name__:
            return kind(*(np.array(fields[field.name], np.float64) for field in dataclasses.fields(kind)))
    raise ValueError(f"unknown embedding {fields['embedding']!r}")


def _arrays_to_fields(embedding: LogitEmbedding | FeatureEmbedding) -> dict[str, Any]:
    arrays = {field.name: getattr(embedding, field.name).tolist() for field in dataclasses.fields(embedding)}
    return {"embedding": type(embedding).__name__, **arrays}
