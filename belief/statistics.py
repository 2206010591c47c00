"""Intervals and paired comparisons for success rates."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from belief.problem import Floats


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson score interval of a proportion: to show (close to nominal coverage).

    >>> [round(x, 3) for x in wilson_interval(53, 100)]
    [0.433, 0.625]
    """
    return _interval(successes, trials, confidence, "wilson")


def clopper_pearson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper-Pearson interval of a proportion: for claims (covers at least ``confidence``).

    >>> [round(x, 4) for x in clopper_pearson_interval(0, 100)]
    [0.0, 0.0362]
    """
    return _interval(successes, trials, confidence, "exact")


def paired_bootstrap(
    first: ArrayLike,
    second: ArrayLike,
    rng: np.random.Generator,
    confidence: float = 0.95,
    num_resamples: int = 2000,
) -> tuple[float, float, float]:
    """Mean of ``first - second`` over paired episodes, with a percentile bootstrap interval over the pairs.

    Args:
        first: one number an episode, ``(n,)``.
        second: the same episodes in the same order, ``(n,)``.
        rng: source of the resamples.
        confidence: of the interval.
        num_resamples: bootstrap resamples.

    Returns:
        (mean difference, lower bound, upper bound).

    Raises:
        ValueError: empty, of different lengths, or not finite.
    """
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if a.ndim != 1 or a.shape != b.shape or a.size == 0:
        raise ValueError(f"need two equally long, non-empty lists of episodes, got {a.shape} and {b.shape}")
    difference = a - b
    if not np.isfinite(difference).all():
        raise ValueError("the paired values must be finite")
    mean = float(difference.mean())
    if a.size == 1 or np.ptp(difference) == 0.0:
        return mean, mean, mean
    means = rng.choice(difference, size=(num_resamples, a.size)).mean(axis=1)
    return mean, *_percentiles(means, confidence)


def cluster_bootstrap(
    values: ArrayLike,
    clusters: ArrayLike,
    rng: np.random.Generator,
    confidence: float = 0.95,
    num_resamples: int = 2000,
) -> tuple[float, float, float]:
    """Mean of values that come in clusters, with a percentile bootstrap interval that resamples whole clusters.

    Touches of one object err together, so an interval that took them for independent would be too narrow.

    Args:
        values: ``(n,)``.
        clusters: to which each belongs, ``(n,)``; any labels.
        rng: source of the resamples.
        confidence: of the interval.
        num_resamples: bootstrap resamples.

    Returns:
        (mean, lower bound, upper bound).

    Raises:
        ValueError: empty, of different lengths, or not finite.
    """
    x, groups = np.asarray(values, np.float64), np.asarray(clusters)
    if x.ndim != 1 or x.shape != groups.shape or x.size == 0:
        raise ValueError(f"need as many clusters as values, at least one of each; got {groups.shape} and {x.shape}")
    if not np.isfinite(x).all():
        raise ValueError("the values must be finite")
    _, index = np.unique(groups, return_inverse=True)
    sums, sizes = np.bincount(index, x), np.bincount(index)
    drawn = rng.integers(len(sizes), size=(num_resamples, len(sizes)))
    means = sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1)
    return float(x.mean()), *_percentiles(means, confidence)


def _percentiles(means: Floats, confidence: float) -> tuple[float, float]:
    """The bounds between which the middle of the resampled means lies."""
    tail = (1.0 - confidence) / 2
    low, high = np.quantile(means, [tail, 1.0 - tail])
    return float(low), float(high)


def _interval(
    successes: int, trials: int, confidence: float, method: Literal["wilson", "exact"]
) -> tuple[float, float]:
    if not 0 <= successes <= trials or trials < 1:
        raise ValueError(f"need 0 ≤ successes ≤ trials and trials ≥ 1, got {successes} of {trials}")
    interval = stats.binomtest(int(successes), int(trials)).proportion_ci(confidence, method)
    return float(interval.low), float(interval.high)
