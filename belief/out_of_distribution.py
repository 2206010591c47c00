r"""Out-of-distribution scores of touches, higher for objects unlike the training set, and their AUROC.

The score is :class:`MahalanobisScore`, the squared Mahalanobis distance of the features to the nearest class mean,
under one covariance shared by all classes (Lee et al. 2018).

    >>> rng = np.random.default_rng(0)
    >>> labels = np.arange(200) % 2
    >>> score = MahalanobisScore.fit(rng.normal(size=(200, 3)) + 6.0 * labels[:, None], labels)
    >>> known, novel = rng.normal(size=(50, 3)), rng.normal(size=(50, 3)) - 6.0
    >>> auroc(score.score(known), score.score(novel))
    1.0
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike
from scipy.special import expit

from belief.frozen import FrozenArrays
from belief.statistics.proportion import exact_interval, normal_quantile
from belief.validation import Floats, as_real, checked_values, require_fraction, require_number, unmasked

_ROUNDING = 1e-20  # largest variance of an AUROC that is taken as zero
_LEAST_SHRINKAGE = 1e-6  # few samples can make the estimate zero and the covariance singular


@dataclass(frozen=True, eq=False)
class MahalanobisScore(FrozenArrays):
    """Squared Mahalanobis distance to the nearest class mean.

    The shared covariance is shrunk towards a multiple of the identity, (1 - ρ) S + ρ (tr S / D) I, so that it is
    invertible with fewer samples than dimensions. By default ρ minimises the expected squared error of the estimate
    (Ledoit and Wolf 2004).

    Attributes:
        means: of the C classes in the data, ``(C, D)``.
        whitening: matrix that, multiplied from the right, maps deviations to unit covariance, ``(D, D)``.
        shrinkage: ρ in [0, 1].

    Raises:
        ValueError: arrays that do not fit each other, NaN, masked entries, or a shrinkage out of range.
    """

    means: Floats
    whitening: Floats
    shrinkage: float

    def __post_init__(self) -> None:
        self.to_floats("means")
        self.to_floats("whitening", finite=False)  # it overflows for features that hardly vary
        size = self.means.shape[-1] if self.means.ndim == 2 else 0
        if size == 0 or len(self.means) == 0 or self.whitening.shape != (size, size):
            raise ValueError(
                f"need means (C, D) and whitening (D, D), got {self.means.shape} and {self.whitening.shape}"
            )
        require_number("shrinkage", self.shrinkage, 0.0, 1.0)
        self.freeze()

    @classmethod
    def fit(cls, features: ArrayLike, labels: ArrayLike, shrinkage: float | None = None) -> MahalanobisScore:
        """Fit the class means and the shared covariance (with divisor n) to known objects.

        Args:
            features: ``(n, D)``, any float type.
            labels: class of each, integers, ``(n,)``.
            shrinkage: ρ in [0, 1]; that of Ledoit and Wolf by default, at least 1e-6. If nothing varies within the
                classes, the covariance is the identity.

        Raises:
            ValueError: empty, not finite, or beyond ±1e150; labels that are not integers or do not fit; a
                singular covariance with the given shrinkage.
        """
        x, y = _features(features), unmasked(labels, "labels")
        if y.shape != (len(x),) or not np.issubdtype(y.dtype, np.integer):
            raise ValueError(f"need an integer label for each of {len(x)} features, got {y.dtype} {y.shape}")
        if shrinkage is not None and not 0.0 <= shrinkage <= 1.0:
            raise ValueError(f"shrinkage must be in [0, 1], got {shrinkage}")
        _, inverse = np.unique(y, return_inverse=True)
        members = np.eye(inverse.max() + 1)[inverse]  # (n, C)
        means = (members / members.sum(axis=0)).T @ x
        residuals = x - means[inverse]
        scale = float(np.abs(residuals).max())
        # Rounding of means leaves residuals of some units in the last place for constant features.
        if scale <= 16 * np.finfo(np.float64).eps * float(np.abs(x).max()):
            return cls(means, np.eye(x.shape[1]), 1.0)
        residuals /= scale
        covariance = residuals.T @ residuals / len(x)
        chosen = max(_ledoit_wolf(residuals, covariance), _LEAST_SHRINKAGE) if shrinkage is None else shrinkage
        spread = np.trace(covariance) / x.shape[1]
        shrunk = (1.0 - chosen) * covariance + chosen * spread * np.eye(x.shape[1])
        try:
            root = scipy.linalg.cholesky(shrunk, lower=True)
        except np.linalg.LinAlgError as error:
            raise ValueError(
                f"the covariance of {len(x)} features in {x.shape[1]} dimensions is singular with shrinkage {chosen}; "
                "use the default shrinkage or a larger one"
            ) from error
        return cls(means, scipy.linalg.solve_triangular(root, np.eye(x.shape[1]), lower=True).T / scale, float(chosen))

    def score(self, features: ArrayLike) -> Floats:
        """Squared distance of each row of ``features (n, D)`` to the nearest class mean, ``(n,)``, ≥ 0.

        Raises:
            ValueError: empty, not finite, beyond ±1e150, or of another dimension than in the fit.
        """
        x = _features(features)
        if x.shape[1] != self.means.shape[1]:
            raise ValueError(f"fitted to features of {self.means.shape[1]} dimensions, got {x.shape[1]}")
        centre = self.means.mean(axis=0)  # near the data, so that a common offset loses no digits
        with np.errstate(over="ignore", invalid="ignore"):
            whitened, means = (x - centre) @ self.whitening, (self.means - centre) @ self.whitening
            distances = scipy.spatial.distance.cdist(whitened, means, "sqeuclidean").min(axis=1)
        return np.where(np.isnan(distances), np.inf, distances)  # the distance overflows


def auroc(known_scores: ArrayLike, novel_scores: ArrayLike) -> float:
    """P(a novel score exceeds a known one) + 0.5 P(they are equal), over all pairs of arrays of any shape; in [0, 1].

    Raises:
        ValueError: one of them is empty or has NaN.

    >>> auroc([1.0, 2.0], [2.0, 3.0])      # of four pairs three are in order, one is tied
    0.875
    """
    known, novel = _scores(known_scores, novel_scores)
    ranks = _ranks(np.concatenate([known.ravel(), novel.ravel()]))
    excess = ranks[known.size :].sum() - novel.size * (novel.size + 1) / 2
    return float(excess / (known.size * novel.size))


def auroc_interval(
    known_scores: ArrayLike, novel_scores: ArrayLike, confidence: float = 0.95
) -> tuple[float, float, float]:
    """AUROC with a confidence interval for independent rows, whose scores may depend on each other within a row.

    The variance is that of DeLong et al. (1988) with scores averaged within rows (Obuchowski 1997), on the logit scale.
    Where it is zero, as for an AUROC of 0 or 1, the interval is the exact binomial one for min(n, m) pairs of rows.

    Args:
        known_scores: one score per row, ``(n,)``, or several, ``(n, T)``, such as one per touch of an object; n ≥ 2.
        novel_scores: ``(m,)`` or ``(m, T')``, m ≥ 2.
        confidence: of the interval, in (0, 1).

    Returns:
        (AUROC, lower bound, upper bound).

    Raises:
        ValueError: as :func:`auroc`; fewer than two rows; a confidence outside (0, 1).

    >>> [round(x, 3) for x in auroc_interval(np.arange(50), np.arange(50) + 20.0)]
    [0.82, 0.728, 0.886]
    """
    known, novel = _scores(known_scores, novel_scores)
    if min(len(known), len(novel)) < 2:
        raise ValueError(f"an interval needs at least two rows of each, got {len(known)} known and {len(novel)} novel")
    require_fraction("confidence", confidence)
    value = auroc(known, novel)
    variance = _row_means(novel, known).var(ddof=1) / len(novel) + _row_means(known, novel).var(ddof=1) / len(known)
    if variance < _ROUNDING:
        right, wrong = np.array([value, 1.0 - value]) * min(len(known), len(novel))
        return value, *exact_interval(right, wrong, confidence)
    centre = np.log(value) - np.log1p(-value)
    reach = normal_quantile(confidence) * np.sqrt(variance) / (value * (1.0 - value))
    return value, float(expit(centre - reach)), float(expit(centre + reach))


def _ledoit_wolf(residuals: Floats, covariance: Floats) -> float:
    """Optimal shrinkage towards the scaled identity (Ledoit and Wolf 2004, section 3.3) for a known mean."""
    n, dimensions = residuals.shape
    spread = np.trace(covariance) / dimensions
    distance = np.square(covariance - spread * np.eye(dimensions)).sum()
    if distance == 0.0:
        return 1.0
    # Σ_i |x_i x_iᵀ - S|² = Σ_i |x_i|⁴ - n |S|²
    error = (np.square(np.square(residuals).sum(axis=1)).sum() / n - np.square(covariance).sum()) / n
    return float(np.clip(error / distance, 0.0, 1.0))


def _row_means(rows: Floats, others: Floats) -> Floats:
    """Fraction of ``others`` that a row's scores exceed, ties half, averaged over the row, ``(len(rows),)``."""
    pooled = _ranks(np.concatenate([rows.ravel(), others.ravel()]))[: rows.size]
    exceeded = (pooled - _ranks(rows.ravel())) / others.size
    return np.asarray(exceeded.reshape(len(rows), -1).mean(axis=1))


def _ranks(scores: Floats) -> Floats:
    """Ranks from 1, equal scores sharing their mean rank, ``(n,)``.

    It is ``scipy.stats.rankdata`` without ``scipy.stats``, which would take a third of the time to import belief.
    """
    _, inverse, counts = np.unique(scores, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[inverse]


def _features(features: ArrayLike) -> Floats:
    x = checked_values("features", as_real(features, "features"))
    if x.ndim != 2 or x.size == 0:
        raise ValueError(f"need features (n, D) with n ≥ 1 and D ≥ 1, got shape {x.shape}")
    return x


def _scores(known_scores: ArrayLike, novel_scores: ArrayLike) -> tuple[Floats, Floats]:
    known = np.asarray(as_real(known_scores, "known_scores"), np.float64)
    novel = np.asarray(as_real(novel_scores, "novel_scores"), np.float64)
    for name, scores in (("known", known), ("novel", novel)):
        if scores.ndim == 0 or scores.size == 0:
            raise ValueError(f"{name}_scores must hold at least one score, got shape {scores.shape}")
        if np.isnan(scores).any():
            raise ValueError(f"{name}_scores hold NaN, the first at {np.argwhere(np.isnan(scores))[0].tolist()}")
    return known, novel
