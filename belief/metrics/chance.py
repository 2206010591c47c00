r"""What chance does to calibration errors: their null distribution, and intervals without their bias.

Sampling noise adds a term b² to the square of an error. A bootstrap resample has this term twice:

    E[error²] = truth² + b²,        E[error*²] = error² + b²        (to the same order).

It is therefore subtracted once from the estimate and twice from the resamples:

    estimate² = error² - b² = 2 error² - E[error*²],        bounds² = quantiles of error*² - 2 b².
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.validation import Floats, checked_pair, checked_probs, require_count, require_fraction

Metric: TypeAlias = Callable[[Floats, NDArray[np.int64]], float]
_BLOCK = 2_000_000  # labels held in memory at a time


def null_quantile(
    probs: ArrayLike, metric: Metric, rng: np.random.Generator, quantile: float = 0.95, num_resamples: int = 1000
) -> float:
    """Quantile of a metric for a perfectly calibrated model with these predictions.

    Labels are drawn from the predicted probabilities. A model whose calibration error is below the 95 % quantile cannot
    be distinguished from a calibrated one.

    Args:
        probs: ``(n, K)``.
        metric: a function of ``(probs (n, K), labels (n,))``, such as ``expected_calibration_error``.
        rng: draws the labels.
        quantile: in (0, 1).
        num_resamples: number of sets of n labels.

    Raises:
        ValueError: as :func:`~belief.validation.checked_probs`; a quantile outside (0, 1), or a metric that returns
            NaN or infinity.

    >>> from belief.metrics import expected_calibration_error
    >>> sure, unsure = np.array([[1.0, 0.0]] * 100), np.array([[0.5, 0.5]] * 100)
    >>> null_quantile(sure, expected_calibration_error, np.random.default_rng(0))
    0.0
    >>> round(null_quantile(unsure, expected_calibration_error, np.random.default_rng(0)), 2)    # 1.96 · 0.5 / √100
    0.1
    """
    p = checked_probs(probs)
    require_fraction("quantile", quantile)
    scores = [evaluated(metric, p, labels) for block in drawn_labels(p, rng, num_resamples) for labels in block]
    return float(np.quantile(scores, quantile))


def drawn_labels(probs: Floats, rng: np.random.Generator, num_resamples: int) -> Iterator[NDArray[np.int64]]:
    """Sets of labels drawn from checked ``probs (n, K)``, in blocks ``(number of sets, n)`` that fit in memory."""
    require_count("num_resamples", num_resamples)
    cumulative = probs.cumsum(axis=1)
    cumulative /= cumulative[:, -1:]  # exactly one at the end
    size = max(1, _BLOCK // len(probs))
    for done in range(0, num_resamples, size):
        uniform = rng.random((min(size, num_resamples - done), len(probs)))
        labels = np.zeros(uniform.shape, np.int64)
        for bound in cumulative[:, :-1].T:
            labels += uniform >= bound
        yield labels


def evaluated(metric: Metric, probs: Floats, labels: NDArray[np.int64]) -> float:
    """The metric's value; raises ValueError if it is not finite.

    >>> evaluated(lambda probs, labels: np.nan, np.eye(2), np.arange(2))
    Traceback (most recent call last):
    ValueError: the metric must return a finite number, got nan
    """
    value = float(metric(probs, labels))
    if not np.isfinite(value):
        raise ValueError(f"the metric must return a finite number, got {value}")
    return value


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
