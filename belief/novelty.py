"""How unlike the touches of known shapes the embedding of a touch is, comparable between shapes.

>>> rng = np.random.default_rng(0)
>>> shapes = np.arange(400) % 2
>>> known = (1.0 + 9.0 * shapes[:, None]) * rng.normal(size=(400, 3)) + 40.0 * shapes[:, None]
>>> novelty = Novelty.fit(known, shapes)
>>> novelty.score(np.array([[1.0, 1.0, 1.0], [50.0, 40.0, 40.0], [20.0, 0.0, 0.0]])).round(1).tolist()
[0.1, -0.4, 3.7]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from belief.frozen import FrozenArrays
from belief.out_of_distribution import MahalanobisScore
from belief.validation import Floats

_LARGEST = 1e30  # number in an embedding
_LARGEST_SINGLE = float(np.finfo(np.float32).max)
_LEAST_WIDTH = 1e-2  # of log distances
_WIDEST = 1e3  # score


@dataclass(frozen=True, eq=False)
class Novelty(FrozenArrays):
    """Log distance to the nearest shape, relative to the distances of this shape's own touches.

    Distances are Mahalanobis distances with one covariance for all shapes. Some shapes look more alike from all sides
    than others, so the log distance to each shape is standardised by its own touches before the least is taken.

    Attributes:
        means: of the C shapes in the data, ``(C, D)``.
        whitening: maps deviations to unit covariance, ``(D, D)``.
        levels: mean log distance of each shape's own touches, ``(C,)``.
        widths: their standard deviations, ``(C,)``.
    """

    means: Floats
    whitening: Floats
    levels: Floats
    widths: Floats

    @classmethod
    def fit(cls, embeddings: Floats, shapes: ArrayLike) -> Novelty:
        """Fit to embeddings ``(n, D)`` of touches of known shapes ``(n,)``, rounded to single precision."""
        limited, truth = np.clip(embeddings, -_LARGEST, _LARGEST), np.asarray(shapes)
        found = MahalanobisScore.fit(limited, truth)
        whitening = np.clip(found.whitening, -_LARGEST_SINGLE, _LARGEST_SINGLE)
        each = np.unique(truth)
        blank = cls(found.means, whitening, np.zeros(len(each)), np.ones(len(each)))
        own = [blank.distances(limited[truth == shape])[:, number] for number, shape in enumerate(each)]
        levels = np.array([some.mean() for some in own])
        widths = np.maximum([some.std() for some in own], _LEAST_WIDTH)
        return cls(*(array.astype(np.float32).astype(np.float64) for array in (found.means, whitening, levels, widths)))

    def distances(self, embeddings: Floats) -> Floats:
        """Log of 1 plus the squared distance to each shape, at most 1e3, ``(n, C)`` for embeddings ``(n, D)``."""
        centre, means = self._white
        with np.errstate(over="ignore", invalid="ignore"):
            points = (np.minimum(np.maximum(embeddings, -_LARGEST), _LARGEST) - centre) @ self.whitening
            away = points[:, None] - means
            found = np.log1p(np.square(away).sum(axis=2))
        return np.fmin(found, _WIDEST)  # also in place of NaN

    @cached_property
    def _white(self) -> tuple[Floats, Floats]:
        """A point near the data, so that a common offset loses no digits, and the means from there, whitened."""
        centre = self.means.mean(axis=0)
        with np.errstate(over="ignore", invalid="ignore"):
            return centre, (self.means - centre) @ self.whitening

    def score(self, embeddings: Floats) -> Floats:
        """Novelty of each embedding, ``(n,)`` for ``(n, D)``: about 0 ± 1 for touches of known shapes."""
        return np.asarray(((self.distances(embeddings) - self.levels) / self.widths).min(axis=1))
