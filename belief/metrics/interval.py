r"""An interval for a calibration error, which is itself too large by chance.

Noise adds to an error as it does to a length: in squares. So a resample of n rows has, in the mean, as square

    E[error*²] = error² + b²,        where, to the same order,        E[error²] = truth² + b²,

b² being what chance adds once. The resamples hold it twice, and twice it is taken off their squares:

    estimate² = error² - b² = 2 error² - E[error*²],        bounds² = quantiles of error*² - 2 b².

The same correction without the squares takes off too little where the truth is near zero, as |noise| of two independent
sources grows by √2 and not by 2.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.metrics.inputs import checked_pair
from belief.metrics.null_distribution import Metric, evaluated
from belief.statistics.inputs import require_fraction
from belief.validation import require_count


def bias_corrected_interval(
    probs: ArrayLike,
    labels: ArrayLike,
    metric: Metric,
    rng: np.random.Generator,
    clusters: ArrayLike | None = None,
    confidence: float = 0.95,
    num_resamples: int = 1000,
) -> tuple[float, float, float]:
    """A calibration error less its upward bias, with a bootstrap interval that is corrected as well.

    By ``python benchmarks/coverage.py`` (seed 0, 1000 rows of four shapes, 200 resamples, 400 data sets a figure) 95 %
    intervals hold the true ECE in 0.998, 0.988, 0.965, 0.940 of cases where it is 0, 0.022, 0.045, 0.095, and the
    classwise one in 1.000, 0.988, 0.985, 0.955 where it is 0, 0.011, 0.023, 0.048; uncorrected percentiles of the
    resamples do in 0, 0.02, 0.69, 0.90, and in 0, 0, 0, 0.17. Of smECE, to which noise does not add quite in squares,
    they hold 0.90, 0.96, 0.96, 0.89 (100 data sets).

    Args:
        probs: ``(n, K)``, n ≥ 2.
        labels: ``(n,)``.
        metric: a function of ``(probs, labels)`` that is zero in the limit for a calibrated model and never negative,
            such as ``classwise_calibration_error``; options by ``functools.partial``.
        rng: source of the resamples.
        clusters: to which each row belongs, ``(n,)``, any labels, as the object of a touch: these are then resampled
            whole. By default every row by itself.
        confidence: of the interval, in (0, 1).
        num_resamples: bootstrap resamples.

    Returns:
        (estimate, lower bound, upper bound), each cut off at zero.

    Raises:
        ValueError: rows that are no distributions, labels out of range, one cluster only, a confidence outside (0, 1),
            a metric that returns something negative or not finite.

    >>> from belief.metrics import expected_calibration_error
    >>> probs, labels = np.array([[0.9, 0.1]] * 200), np.arange(200) % 2             # sure at 90 %, right at 50 %
    >>> interval = bias_corrected_interval(probs, labels, expected_calibration_error, np.random.default_rng(0))
    >>> [round(bound, 2) for bound in interval]
    [0.4, 0.33, 0.47]
    """
    p, y = checked_pair(probs, labels)
    groups = np.arange(len(y)) if clusters is None else np.asarray(clusters)
    if groups.shape != y.shape:
        raise ValueError(f"need a cluster for each of {len(y)} rows, got shape {groups.shape}")
    require_fraction("confidence", confidence)
    square = _squared(evaluated(metric, p, y))
    squares = np.array(
        [_squared(evaluated(metric, p[rows], y[rows])) for rows in _resamples(groups, rng, num_resamples)]
    )
    added = squares.mean() - square
    tail = (1.0 - confidence) / 2
    bounds = np.quantile(squares, [tail, 1.0 - tail]) - 2.0 * added
    estimate, low, high = np.sqrt(np.maximum([square - added, *bounds], 0.0)).tolist()
    return estimate, low, high


def _squared(error: float) -> float:
    if error < 0.0:
        raise ValueError(f"the metric must never be negative, got {error}; a debiased one needs no correction")
    return error * error


def _resamples(
    clusters: NDArray[np.generic], rng: np.random.Generator, num_resamples: int
) -> Iterator[NDArray[np.int64]]:
    """Rows of the clusters that were drawn, as often as they were drawn."""
    require_count("num_resamples", num_resamples)
    _, index, sizes = np.unique(clusters, return_inverse=True, return_counts=True)
    if len(sizes) < 2:
        raise ValueError(f"an interval needs two clusters at least, got {len(sizes)}")
    rows, starts = np.argsort(index, kind="stable"), np.cumsum(sizes) - sizes
    for _ in range(num_resamples):
        drawn = rng.integers(len(sizes), size=len(sizes))
        lengths = sizes[drawn]
        offsets = np.cumsum(lengths) - lengths  # where each drawn cluster begins in the resample
        yield rows[np.arange(lengths.sum()) + np.repeat(starts[drawn] - offsets, lengths)]
