"""Percentile bootstrap intervals of a mean: over pairs, over clusters, within strata (Efron and Tibshirani 1993)."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.problem import Floats
from belief.statistics.inputs import checked_values, require_fraction
from belief.validation import require_count

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
    x, groups = _labelled(values, clusters, "clusters")
    require_fraction("confidence", confidence)
    _, index = np.unique(groups, return_inverse=True)
    sums, sizes = np.bincount(index, x), np.bincount(index)
    blocks = _index_blocks(len(sizes), rng, num_resamples)
    means = np.concatenate([sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1) for drawn in blocks])
    return _with_bounds(x, means, confidence)


def stratified_bootstrap(
    values: ArrayLike,
    strata: ArrayLike,
    rng: np.random.Generator,
    confidence: float = 0.95,
    num_resamples: int = 2000,
    weights: Mapping[Hashable, float] | None = None,
) -> tuple[float, float, float]:
    """Weighted mean of the means of strata, with a percentile bootstrap interval that resamples within strata.

    The numbers of values per stratum are held fixed. For a comparison of deciders on the same episodes, pass the
    differences as values.

    Args:
        values: ``(n,)``.
        strata: stratum of each value, ``(n,)``; any labels.
        rng: draws the resamples.
        confidence: of the interval, in (0, 1).
        num_resamples: bootstrap resamples.
        weights: of each stratum, by label, ≥ 0 and not all zero; they are normalised. Equal by default.

    Returns:
        (weighted mean, lower bound, upper bound).

    Raises:
        ValueError: empty, of different lengths, not finite or beyond ±1e150; invalid weights, or weights of other
            strata.

    >>> rng = np.random.default_rng(0)
    >>> [round(x, 2) for x in stratified_bootstrap([1, 1, 1, 1, 0, 1], ["cube"] * 4 + ["cone"] * 2, rng)]
    [0.75, 0.5, 1.0]
    """
    x, groups = _labelled(values, strata, "strata")
    require_fraction("confidence", confidence)
    names, index = np.unique(groups, return_inverse=True)
    shares = _shares(names.tolist(), weights)
    members = [x[index == stratum] for stratum in range(len(names))]
    means = np.stack([_resampled_means(inside, rng, num_resamples) for inside in members])  # (strata, resamples)
    centres = np.array([inside.mean() for inside in members])
    return float(shares @ centres), *_percentiles(shares @ means, confidence)


def _shares(names: list[Hashable], weights: Mapping[Hashable, float] | None) -> Floats:
    if weights is None:
        return np.full(len(names), 1.0 / len(names))
    if set(weights) != set(names):
        raise ValueError(f"weights must name the strata {names}, got {list(weights)}")
    w = checked_values("weights", [weights[name] for name in names])
    if w.min() < 0.0 or w.max() == 0.0:
        raise ValueError(f"weights must be ≥ 0 and not all zero, got {dict(weights)}")
    w = w / w.max()
    return np.asarray(w / w.sum())


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
    return float(values.mean()), *_percentiles(means, confidence)


def _percentiles(means: Floats, confidence: float) -> tuple[float, float]:
    """Percentiles of the resampled means."""
    tail = (1.0 - confidence) / 2
    low, high = np.quantile(means, [tail, 1.0 - tail])
    return float(low), float(high)


def _labelled(values: ArrayLike, labels: ArrayLike, kind: str) -> tuple[Floats, NDArray[np.generic]]:
    x, groups = checked_values("the values", values), np.asarray(labels)
    if x.ndim != 1 or x.shape != groups.shape or x.size == 0:
        raise ValueError(f"need as many {kind} as values, at least one of each; got {groups.shape} and {x.shape}")
    return x, groups
