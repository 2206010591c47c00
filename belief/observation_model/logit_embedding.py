"""Embedding of logits as vectors with few components, for Gaussian models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.frozen import FrozenArrays
from belief.touch_batch import TouchBatch
from belief.validation import Floats

_LARGEST = 1e300  # sums and differences of a few thousand such numbers are finite
_MOST_UNITS = 3.0


@dataclass(frozen=True, eq=False)
class LogitEmbedding(FrozenArrays):
    """The centred logits in an orthonormal basis of K - 1 vectors; a softmax does not depend on the mean.

    Logits are clipped to the range of the calibration touches, and to three units, so that a single extreme touch
    cannot dominate. One unit is the 90th percentile of the sizes of the calibration touches.

    Attributes:
        lowest, highest: bounds to which centred logits are clipped, ``(K,)``.
        unit: size of one unit of the vectors, in logits, > 0.
    """

    lowest: Floats
    highest: Floats
    unit: float = 1.0

    def __post_init__(self) -> None:
        self.to_floats("lowest", "highest", finite=False)
        if self.lowest.ndim != 1 or self.lowest.shape != self.highest.shape or not (self.lowest <= self.highest).all():
            raise ValueError(f"need lowest ≤ highest for every component, got {self.lowest} and {self.highest}")
        if not 0.0 < self.unit < np.inf:
            raise ValueError(f"unit must be finite and > 0, got {self.unit}")
        if len(self.lowest) < 2:
            raise ValueError("an embedding of logits needs at least two shapes, got one")
        self.freeze()

    @classmethod
    def fit(cls, batch: TouchBatch) -> LogitEmbedding:
        """The embedding with the range of these touches."""
        away = _centred(batch.require_logits()).reshape(-1, batch.num_shapes)
        unit = _typical_size(away)
        most = min(_MOST_UNITS * unit, _LARGEST)
        return cls(np.maximum(away.min(axis=0), -most), np.minimum(away.max(axis=0), most), unit)

    @property
    def num_components(self) -> int:
        """D = K - 1."""
        return len(self.lowest) - 1

    def __call__(self, batch: TouchBatch) -> Floats:
        """Vectors of touches, ``(S, n, D)``."""
        clipped = np.minimum(np.maximum(_centred(batch.require_logits()), self.lowest), self.highest)
        return np.asarray(clipped @ _basis(len(self.lowest)).T / self.unit)

    def to_touches(self, poses: NDArray[np.int64], vectors: Floats) -> TouchBatch:
        """Touches in ``poses (S, n)`` with vectors ``(S, n, D)``; the logits have mean zero."""
        return TouchBatch(poses, vectors @ _basis(len(self.lowest)) * self.unit)

    def to_fields(self) -> dict[str, Any]:
        """All attributes, as JSON types."""
        return {"lowest": self.lowest.tolist(), "highest": self.highest.tolist(), "unit": self.unit}

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> LogitEmbedding:
        """The embedding of fields from :meth:`to_fields`."""
        lowest, highest = (np.array(fields[name], np.float64) for name in ("lowest", "highest"))
        return cls(lowest, highest, float(fields["unit"]))


@lru_cache
def _basis(num_shapes: int) -> Floats:
    """Orthonormal rows ``(K - 1, K)`` that are orthogonal to a constant."""
    return scipy.linalg.helmert(num_shapes)


def _centred(logits: Floats) -> Floats:
    z = np.minimum(np.maximum(logits, -_LARGEST), _LARGEST)
    return np.asarray(z - z.mean(axis=-1, keepdims=True))


def _typical_size(away: Floats) -> float:
    """90th percentile of the largest entry of each row ``(n, K)``; 1 if all are zero."""
    sizes = np.sort(np.abs(away).max(axis=1))
    typical = sizes[int(0.9 * (len(sizes) - 1))]
    typical = typical if typical > 0.0 else sizes[np.searchsorted(sizes, 0.0, "right") % len(sizes)]
    return max(float(typical), np.finfo(float).tiny) if typical > 0.0 else 1.0
