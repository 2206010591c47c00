"""Embeddings of touches as vectors with few components, for Gaussian models.

Both embeddings clip their input, so that a single extreme touch cannot dominate: to the range of the calibration
touches, and to three units. One unit is the 90th percentile of the sizes of the calibration touches.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.frozen import FrozenArrays
from belief.problem import Floats
from belief.touch_batch import TouchBatch

_LARGEST = 1e300  # sums and differences of a few thousand such numbers are finite
_MOST_UNITS = 3.0


class Embedding(Protocol):
    """A map from touches to vectors, and back."""

    @property
    def num_components(self) -> int:
        """D."""

    def __call__(self, batch: TouchBatch) -> Floats:
        """Vectors of touches, ``(S, n, D)``."""

    def to_touches(self, poses: NDArray[np.int64], vectors: Floats) -> TouchBatch:
        """Touches in ``poses (S, n)`` with vectors ``(S, n, D)``."""

    def to_fields(self) -> dict[str, Any]:
        """All attributes, as JSON types; :func:`embedding_from_fields` reads them."""


@dataclass(frozen=True, eq=False)
class LogitEmbedding(FrozenArrays):
    """The centred logits in an orthonormal basis of K - 1 vectors; a softmax does not depend on the mean.

    Attributes:
        lowest, highest: bounds to which centred logits are clipped, ``(K,)``.
        unit: size of one unit of the vectors, in logits, > 0.

    Raises:
        ValueError: invalid bounds, fewer than two shapes, or a unit out of range.

    Example:
        >>> embedding = LogitEmbedding(np.array([-3.0, -3.0]), np.array([3.0, 3.0]))
        >>> batch = TouchBatch(np.zeros((1, 2), int), np.array([[[2.0, 0.0], [1e308, 0.0]]]))
        >>> embedding(batch).round(3).ravel()
        array([1.414, 4.243])
        >>> embedding.to_touches(batch.poses, embedding(batch)).logits.round(3).tolist()
        [[[1.0, -1.0], [3.0, -3.0]]]
    """

    lowest: Floats
    highest: Floats
    unit: float = 1.0

    def __post_init__(self) -> None:
        self.to_floats("lowest", "highest", finite=False)
        _check_bounds(self.lowest, self.highest, self.unit)
        if len(self.lowest) < 2:
            raise ValueError("an embedding of logits needs at least two shapes, got one")
        self.freeze()

    @classmethod
    def fit(cls, batch: TouchBatch) -> LogitEmbedding:
        """The embedding with the range of these touches.

        >>> rng = np.random.default_rng(0)
        >>> embedding = LogitEmbedding.fit(TouchBatch(np.zeros((1, 99), int), rng.normal(size=(1, 99, 3))))
        >>> embedding.num_components, embedding.highest.round(1).tolist()
        (2, [2.7, 2.1, 1.7])
        """
        away = _centred(batch.require_logits()).reshape(-1, batch.num_shapes)
        unit = _typical_size(away)
        return cls(*_extremes(away, unit), unit)

    @property
    def num_components(self) -> int:
        """K - 1."""
        return len(self.lowest) - 1

    def __call__(self, batch: TouchBatch) -> Floats:
        """See :class:`Embedding`."""
        return self.cut(batch.require_logits()) @ _basis(len(self.lowest)).T / self.unit

    def cut(self, logits: Floats) -> Floats:
        """Centred and clipped logits, ``(..., K)``."""
        return np.minimum(np.maximum(_centred(logits), self.lowest), self.highest)

    def to_touches(self, poses: NDArray[np.int64], vectors: Floats) -> TouchBatch:
        """See :class:`Embedding`; the logits have mean zero."""
        return TouchBatch(poses, vectors @ _basis(len(self.lowest)) * self.unit)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`Embedding`."""
        return _to_fields(self)


@dataclass(frozen=True, eq=False)
class FeatureEmbedding(FrozenArrays):
    """The leading principal components of the classifier's features.

    Attributes:
        centre: mean of the features, ``(F,)``.
        components: orthonormal rows ``(D, F)``.
        lowest, highest: bounds to which components are clipped, in units of the features, ``(D,)``.
        readout: linear map from vectors to logits, ``(D, K)``.
        offset: logits at the centre, ``(K,)``.
        unit: size of one unit of the vectors, in units of the features, > 0.

    Raises:
        ValueError: arrays that do not fit each other or are not finite, invalid bounds, or a unit out of range.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> features = rng.normal(size=(1, 500, 2)) @ np.array([[3.0, 0.0, 3.0], [0.0, 0.1, 0.0]])
        >>> batch = TouchBatch(np.zeros((1, 500), int), features[..., :2], features)
        >>> embedding = FeatureEmbedding.fit(batch, num_components=1)
        >>> np.abs(embedding.components).round(2).tolist()
        [[0.71, 0.0, 0.71]]
        >>> again = embedding.to_touches(batch.poses, embedding(batch)).features
        >>> float(np.abs(again - features).max().round(1))            # the part of the second component
        0.4
    """

    centre: Floats
    components: Floats
    lowest: Floats
    highest: Floats
    readout: Floats
    offset: Floats
    unit: float = 1.0

    def __post_init__(self) -> None:
        self.to_floats("lowest", "highest", finite=False)
        self.to_floats("centre", "components", "readout", "offset")
        _check_bounds(self.lowest, self.highest, self.unit)
        arrays = (self.centre, self.components, self.readout, self.offset)
        sizes = (len(self.lowest), len(self.centre), len(self.offset))
        if [part.shape for part in arrays] != [sizes[1:2], sizes[:2], sizes[::2], sizes[2:]]:
            raise ValueError(
                "need centre (F,), components (D, F), bounds (D,), readout (D, K) and offset (K,), got "
                f"{', '.join(str(part.shape) for part in arrays)}, bounds {self.lowest.shape}"
            )
        self.freeze()

    @classmethod
    def fit(cls, batch: TouchBatch, num_components: int) -> FeatureEmbedding:
        """The principal components of these touches.

        Raises:
            ValueError: the touches have no features, or ``num_components`` is out of range.
        """
        features = _features(batch).reshape(batch.poses.size, -1)
        if not 1 <= num_components <= min(features.shape):
            raise ValueError(f"need between 1 and {min(features.shape)} components, got {num_components}")
        away = features - np.median(features, axis=0)
        unit = _typical_size(away)
        cut = np.clip(away, *_extremes(away, unit)) / unit
        scaled_centre = cut.mean(axis=0)
        cut -= scaled_centre
        _, basis = np.linalg.eigh(cut.T @ cut)
        components = np.ascontiguousarray(basis[:, ::-1][:, :num_components].T)  # as when read from a file
        vectors = cut @ components.T
        logits = LogitEmbedding.fit(batch).cut(batch.require_logits().reshape(len(vectors), -1))
        design = np.column_stack([vectors, np.ones(len(vectors))])
        readout = np.linalg.lstsq(design, logits, rcond=None)[0]
        centre = np.median(features, axis=0) + scaled_centre * unit
        lowest, highest = vectors.min(axis=0) * unit, vectors.max(axis=0) * unit
        return cls(centre, components, lowest, highest, readout[:-1], readout[-1], unit)

    @property
    def num_components(self) -> int:
        """D."""
        return len(self.lowest)

    def __call__(self, batch: TouchBatch) -> Floats:
        """See :class:`Embedding`."""
        features = _features(batch)
        if features.shape[2] != len(self.centre):
            raise ValueError(f"the embedding is of {len(self.centre)} features, touch 0 has {features.shape[2]}")
        vectors = (features - self.centre) @ self.components.T
        return np.minimum(np.maximum(vectors, self.lowest), self.highest) / self.unit

    def to_touches(self, poses: NDArray[np.int64], vectors: Floats) -> TouchBatch:
        """See :class:`Embedding`; the logits are the readout of the components."""
        features = vectors * self.unit @ self.components + self.centre
        return TouchBatch(poses, vectors @ self.readout + self.offset, features)

    def to_fields(self) -> dict[str, Any]:
        """See :class:`Embedding`."""
        return _to_fields(self)


def embedding_from_fields(fields: Mapping[str, Any]) -> LogitEmbedding | FeatureEmbedding:
    """The embedding of fields from :meth:`Embedding.to_fields`.

    Raises:
        ValueError: an unknown embedding, or invalid numbers.

    >>> fields = {"embedding": "LogitEmbedding", "lowest": [-1.0, -2.0], "highest": [1.0, 2.0], "unit": 2.0}
    >>> embedding_from_fields(fields).to_fields() == fields
    True
    """
    for kind in (LogitEmbedding, FeatureEmbedding):
        if fields["embedding"] == kind.__name__:
            names = [field.name for field in dataclasses.fields(kind) if field.name != "unit"]
            values: dict[str, Any] = {name: np.array(fields[name], np.float64) for name in names}
            return kind(**values, unit=float(fields["unit"]))
    raise ValueError(f"unknown embedding {fields['embedding']!r}")


def _to_fields(embedding: LogitEmbedding | FeatureEmbedding) -> dict[str, Any]:
    values = {
        field.name: np.asarray(getattr(embedding, field.name)).tolist() for field in dataclasses.fields(embedding)
    }
    return {"embedding": type(embedding).__name__, **values}


@lru_cache
def _basis(num_shapes: int) -> Floats:
    """Orthonormal rows ``(K - 1, K)`` that are orthogonal to a constant."""
    return scipy.linalg.helmert(num_shapes)


def _centred(logits: Floats) -> Floats:
    z = np.minimum(np.maximum(logits, -_LARGEST), _LARGEST)
    return np.asarray(z - z.mean(axis=-1, keepdims=True))


def _features(batch: TouchBatch) -> Floats:
    if batch.features is None:
        raise ValueError("the touches have no features; use an embedding of logits, or keep the features")
    return np.clip(np.asarray(batch.features, np.float64), -_LARGEST, _LARGEST)


def _typical_size(away: Floats) -> float:
    """90th percentile of the largest entry of each row ``(n, …)``; 1 if all are zero."""
    sizes = np.sort(np.abs(away).max(axis=1))
    typical = sizes[int(0.9 * (len(sizes) - 1))]
    typical = typical if typical > 0.0 else sizes[np.searchsorted(sizes, 0.0, "right") % len(sizes)]
    return max(float(typical), np.finfo(float).tiny) if typical > 0.0 else 1.0


def _extremes(away: Floats, unit: float) -> tuple[Floats, Floats]:
    most = min(_MOST_UNITS * unit, _LARGEST)
    return np.maximum(away.min(axis=0), -most), np.minimum(away.max(axis=0), most)


def _check_bounds(lowest: Floats, highest: Floats, unit: float) -> None:
    if lowest.ndim != 1 or lowest.shape != highest.shape or lowest.size == 0 or not (lowest <= highest).all():
        raise ValueError(f"need lowest ≤ highest for every component, got {lowest} and {highest}")
    if not 0.0 < unit < np.inf:
        raise ValueError(f"unit must be finite and > 0, got {unit}")
