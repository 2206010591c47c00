"""The two scores of the conflict test of a touch, each relative to what is usual: its novelty and its misfit.

>>> rng = np.random.default_rng(0)
>>> shapes = np.arange(400) % 2
>>> known = (1.0 + 9.0 * shapes[:, None]) * rng.normal(size=(400, 3)) + 40.0 * shapes[:, None]
>>> novelty = Novelty.fit(known, shapes)
>>> novelty.score(np.array([[1.0, 1.0, 1.0], [50.0, 40.0, 40.0], [20.0, 0.0, 0.0]])).round(1).tolist()
[0.1, -0.4, 3.7]
>>> certainties = rng.uniform(size=(1000, 2))
>>> misfits = (1.0 - certainties) * rng.exponential(size=(1000, 2))
>>> usual = UsualMisfit.fit(misfits, certainties)
>>> bool(usual.standardised(1, 0.5, 0.95) > usual.standardised(1, 0.5, 0.05))
True
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike

from belief.frozen import FrozenArrays
from belief.validation import Floats

_LARGEST = 1e30  # number in an embedding
_LARGEST_SINGLE = float(np.finfo(np.float32).max)
_LEAST_SHRINKAGE = 1e-6  # few samples can make the estimate zero and the covariance singular
_LEAST_WIDTH = 1e-2  # of log distances, and of misfits [nats]
_WIDEST = 1e3  # score
_MOST_GROUPS = 6
_IN_A_GROUP = 50  # objects, at least
_HIGH = 0.8  # quantile; its distance from the median is the width


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
        each, number = np.unique(truth, return_inverse=True)
        members = np.eye(len(each))[number]  # (n, C)
        means = (members / members.sum(axis=0)).T @ limited
        whitening = np.clip(_whitening(limited - means[number], limited), -_LARGEST_SINGLE, _LARGEST_SINGLE)
        blank = cls(means, whitening, np.zeros(len(each)), np.ones(len(each)))
        own = [blank.distances(limited[truth == shape])[:, number] for number, shape in enumerate(each)]
        levels = np.array([some.mean() for some in own])
        widths = np.maximum([some.std() for some in own], _LEAST_WIDTH)
        return cls(*(array.astype(np.float32).astype(np.float64) for array in (means, whitening, levels, widths)))

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


def _whitening(residuals: Floats, values: Floats) -> Floats:
    """Whitens residuals ``(n, D)`` from the right, by a covariance shrunk as by Ledoit and Wolf (2004, section 3.3)."""
    number, size = residuals.shape
    scale = float(np.abs(residuals).max())
    # Rounding of means leaves residuals of some units in the last place for constant features.
    if scale <= 16 * np.finfo(np.float64).eps * float(np.abs(values).max()):
        return np.eye(size)
    residuals = residuals / scale
    covariance = residuals.T @ residuals / number
    spread = np.trace(covariance) / size
    distance, shrinkage = np.square(covariance - spread * np.eye(size)).sum(), 1.0
    if distance > 0.0:
        # Σ_i |x_i x_iᵀ - S|² = Σ_i |x_i|⁴ - n |S|²
        error = (np.square(np.square(residuals).sum(axis=1)).sum() / number - np.square(covariance).sum()) / number
        shrinkage = float(np.clip(error / distance, _LEAST_SHRINKAGE, 1.0))
    root = scipy.linalg.cholesky((1.0 - shrinkage) * covariance + shrinkage * spread * np.eye(size), lower=True)
    return np.asarray(scipy.linalg.solve_triangular(root, np.eye(size), lower=True).T / scale)


@dataclass(frozen=True, eq=False)
class UsualMisfit(FrozenArrays):
    """Median and width of the misfit after equally many touches, in G groups by the certainty of the shape.

    A touch tells more about an object that is little known, and then fits its earlier touches less well. A search goes
    on with objects that are little known, so their misfits must be compared with those of others like them.

    Attributes:
        edges: certainties between the groups, increasing, ``(T, G - 1)``.
        medians: nats, ``(T, G)``.
        widths: from the median to the 80 % quantile, nats, ``(T, G)``.
    """

    edges: Floats
    medians: Floats
    widths: Floats

    @classmethod
    def fit(cls, misfits: Floats, certainties: Floats) -> UsualMisfit:
        """Fit to misfits of T touches of S objects, and the certainty of the shape before each, ``(S, T)`` both."""
        number, length = misfits.shape
        groups = min(_MOST_GROUPS, max(1, number // _IN_A_GROUP))
        limited = np.clip(misfits, -_WIDEST, _WIDEST)
        edges = np.quantile(certainties, np.arange(1, groups) / groups, axis=0).T.astype(np.float32)
        medians, widths = np.empty((length, groups)), np.empty((length, groups))
        for step in range(length):
            group = edges[step].searchsorted(certainties[:, step], side="right")
            for one in range(groups):
                some = limited[group == one, step] if (group == one).any() else limited[:, step]
                medians[step, one], high = np.quantile(some, [0.5, _HIGH])
                widths[step, one] = max(high - medians[step, one], _LEAST_WIDTH)
        return cls(*(array.astype(np.float32).astype(np.float64) for array in (edges, medians, widths)))

    def standardised(self, step: int, misfit: Floats | float, certainty: Floats | float) -> Floats:
        """Misfits ``(...)`` after ``step`` touches less the median of their group by certainty, in its widths."""
        group = self.edges[step].searchsorted(certainty, side="right")
        limited = np.minimum(np.maximum(misfit, -_WIDEST), _WIDEST)
        return np.asarray((limited - self.medians[step][group]) / self.widths[step][group])
