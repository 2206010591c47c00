"""The null distribution of calibration errors: what chance alone makes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.validation import Floats, checked_probs, require_count, require_fraction

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
    scores = [float(metric(p, labels)) for block in drawn_labels(p, rng, num_resamples) for labels in block]
    if not np.isfinite(scores).all():
        raise ValueError(f"the metric must return finite numbers, got {scores[int(np.argmin(np.isfinite(scores)))]}")
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
