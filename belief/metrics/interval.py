r"""Bias-corrected bootstrap intervals for calibration errors, whose estimates are too large by chance.

Sampling noise adds a term b² to the square of an error. A bootstrap resample has this term twice:

    E[error²] = truth² + b²,        E[error*²] = error² + b²        (to the same order).

It is therefore subtracted once from the estimate and twice from the resamples:

    estimate² = error² - b² = 2 error² - E[error*²],        bounds² = quantiles of error*² - 2 b².
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.metrics.null_distribution import Metric, evaluated
from belief.validation import checked_pair, require_count, require_fraction


def bias_corrected_interval(
    probs: ArrayLike,
    labels: ArrayLike,
    metric: Metric,
    rng: np.random.Generator,
    clusters: ArrayLike | None = None,
    confidence: float = 0.95,
    num_resamples: int = 1000,
) -> tuple[float, float, float]:
    """A calibration error without its upward bias, with a corrected bootstrap interval.

    Coverage of 95 % intervals by ``python benchmarks/coverage.py`` (seed 0, 1000 rows of four shapes, 200 resamples,
    400 data sets per number): 0.998, 0.988, 0.965, 0.940 for a true ECE of 0, 0.022, 0.045, 0.095, and 1.000, 0.988,
    0.985, 0.955 for a true classwise error of 0, 0.011, 0.023, 0.048; without correction 0, 0.02, 0.69, 0.90, and 0, 0,
    0, 0.17. For smECE it is 0.90, 0.96, 0.96, 0.89 (100 data sets).

    Args:
        probs: ``(n, K)``, n ≥ 2.
        labels: ``(n,)``.
        metric: a function of ``(probs, labels)``, never negative and zero in the limit for a calibrated model, such as
            ``classwise_calibration_error``.
        rng: draws the resamples.
        clusters: cluster of each row, ``(n,)``, any labels, such as the object of a touch; whole clusters are
            resampled. By default each row is a cluster.
        confidence: of the interval, in (0, 1).
        num_resamples: bootstrap resamples.

    Returns:
        (estimate, lower bound, upper bound), each at least zero.

    Raises:
        ValueError: as :func:`~belief.validation.checked_pair`; fewer than two clusters, a confidence outside
            (0, 1), or a metric that returns a negative number, NaN or infinity.

    >>> from belief.metrics import expected_calibration_error
    >>> probs, labels = np.array([[0.9, 0.1]] * 200), np.arange(200) % 2             # confidence 90 %, accuracy 50 %
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
    """Rows of the drawn clusters, repeated as often as these are drawn."""
    require_count("num_resamples", num_resamples)
    _, index, sizes = np.unique(clusters, return_inverse=True, return_counts=True)
    if len(sizes) < 2:
        raise ValueError(f"an interval needs at least two clusters, got {len(sizes)}")
    rows, starts = np.argsort(index, kind="stable"), np.cumsum(sizes) - sizes
    for _ in range(num_resamples):
        drawn = rng.integers(len(sizes), size=len(sizes))
        lengths = sizes[drawn]
        offsets = np.cumsum(lengths) - lengths  # where each drawn cluster begins in the resample
        yield rows[np.arange(lengths.sum()) + np.repeat(starts[drawn] - offsets, lengths)]
