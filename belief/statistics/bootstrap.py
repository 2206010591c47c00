"""Percentile bootstrap intervals of a mean over pairs or over clusters (Efron and Tibshirani 1993)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.validation import Floats, checked_values, require_count, require_fraction

_BLOCK = 4_000_000  # draws held in memory at a time


def paired_bootstrap(
    first: ArrayLike,
    second: ArrayLike,
    rng: np.random.Generator,
    confidence: float = 0.95,
    num_resamples: int = 2000,
) -> tuple[float, float, float]:
    """Mean of ``first - second`` over paired episodes, with a percentile bootstrap interval over the pairs.

    Args:
        first: one number per episode, ``(n,)``.
        second: the same episodes in the same order, ``(n,)``.
        rng: draws the resamples.
        confidence: of the interval, in (0, 1).
        num_resamples: bootstrap resamples.

    Returns:
        (mean difference, lower bound, upper bound).

    Raises:
        ValueError: empty, of different lengths, not finite or beyond ±1e150.

    >>> [round(x, 2) for x in paired_bootstrap([1, 1, 0, 1], [0, 1, 0, 0], np.random.default_rng(0))]
    [0.5, 0.0, 1.0]
    """
    a, b = checked_values("the paired values of first", first), checked_values("the paired values of second", second)
    if a.ndim != 1 or a.shape != b.shape or a.size == 0:
        raise ValueError(f"need two equally long, non-empty lists of episodes, got {a.shape} and {b.shape}")
    require_fraction("confidence", confidence)
    return _with_bounds(a - b, _resampled_means(a - b, rng, num_resamples), confidence)


def cluster_bootstrap(
    values: ArrayLike,
    clusters: ArrayLike,
    rng: np.random.Generator,
    confidence: float = 0.95,
    num_resamples: int = 2000,
) -> tuple[float, float, float]:
    """Mean of clustered values, with a percentile bootstrap interval that resamples whole clusters.

    Values ``(n,)`` have cluster labels ``(n,)`` of any kind, such as the object of a touch: touches of one object have
    correlated errors. Other arguments, result and errors are those of :func:`paired_bootstrap`.

    >>> [round(x, 2) for x in cluster_bootstrap([1, 1, 0, 0], ["a", "a", "b", "b"], np.random.default_rng(0))]
    [0.5, 0.0, 1.0]
    """
    x, groups = checked_values("the values", values), np.asarray(clusters)
    if x.ndim != 1 or x.shape != groups.shape or x.size == 0:
        raise ValueError(f"need as many clusters as values, at least one of each; got {groups.shape} and {x.shape}")
    require_fraction("confidence", confidence)
    _, index = np.unique(groups, return_inverse=True)
    sums, sizes = np.bincount(index, x), np.bincount(index)
    blocks = _index_blocks(len(sizes), rng, num_resamples)
    means = np.concatenate([sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1) for drawn in blocks])
    return _with_bounds(x, means, confidence)


def _resampled_means(values: Floats, rng: np.random.Generator, num_resamples: int) -> Floats:
    """Means of resamples, ``(num_resamples,)``; nothing is drawn if all values are equal."""
    require_count("num_resamples", num_resamples)
    if np.ptp(values) == 0.0:
        return np.full(num_resamples, values[0])
    return np.concatenate([values[drawn].mean(axis=1) for drawn in _index_blocks(len(values), rng, num_resamples)])


def _index_blocks(size: int, rng: np.random.Generator, num_resamples: int) -> Iterator[NDArray[np.int64]]:
    """Indices of the resamples, in blocks ``(number of resamples, size)`` that fit in memory."""
    require_count("num_resamples", num_resamples)
    rows = max(1, _BLOCK // size)
    for done in range(0, num_resamples, rows):
        yield rng.integers(size, size=(min(rows, num_resamples - done), size))


def _with_bounds(values: Floats, means: Floats, confidence: float) -> tuple[float, float, float]:
    if np.ptp(values) == 0.0:  # the mean of equal values may differ by rounding
        return float(values[0]), float(values[0]), float(values[0])
    tail = (1.0 - confidence) / 2
    low, high = np.quantile(means, [tail, 1.0 - tail])
    return float(values.mean()), float(low), float(high)
