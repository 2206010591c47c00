"""Measure the coverage of intervals for the calibration error: plain percentiles, and bias-corrected intervals.

Run: python benchmarks/coverage.py         (some minutes on one core)

Four shapes, logits of standard deviation 2.5, predictions sharpened by the power 1/T (T = 1 is calibrated). The true
error is zero if T = 1, otherwise the metric on a million rows.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from belief.metrics import (
    bias_corrected_interval,
    classwise_calibration_error,
    expected_calibration_error,
    smooth_calibration_error,
)
from belief.statistics import wilson_interval
from belief.validation import Floats

NUM_ROWS, NUM_RESAMPLES = 1000, 200
TEMPERATURES = (1.0, 0.9, 0.8, 0.6)
CASES: dict[str, tuple[Callable[..., float], int]] = {  # with the number of data sets
    "ECE": (expected_calibration_error, 400),
    "classwise ECE": (classwise_calibration_error, 400),
    "smECE": (smooth_calibration_error, 100),
}


def draw(rng: np.random.Generator, num_rows: int, temperature: float) -> tuple[Floats, np.ndarray]:
    logits = 2.5 * rng.normal(size=(num_rows, 4))
    true_probs = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    labels = (rng.random(num_rows)[:, None] >= true_probs.cumsum(axis=1)[:, :-1]).sum(axis=1)
    probs = np.exp(logits / temperature)
    return probs / probs.sum(axis=1, keepdims=True), labels


def true_error(metric: Callable[..., float], temperature: float) -> float:
    if temperature == 1.0:
        return 0.0
    return metric(*draw(np.random.default_rng(1), 1_000_000, temperature))


def main() -> None:
    print(f"{'metric':<14}{'T':>4}{'truth':>8}{'plain':>8}{'ours':>7}   95 % interval of ours")
    rng = np.random.default_rng(0)
    for name, (metric, num_sets) in CASES.items():
        for temperature in TEMPERATURES:
            truth, plain, ours = true_error(metric, temperature), 0, 0
            for _ in range(num_sets):
                probs, labels = draw(rng, NUM_ROWS, temperature)
                _, low, high = bias_corrected_interval(probs, labels, metric, rng, num_resamples=NUM_RESAMPLES)
                ours += low <= truth <= high
                rows = rng.integers(NUM_ROWS, size=(NUM_RESAMPLES, NUM_ROWS))
                low, high = np.quantile([metric(probs[row], labels[row]) for row in rows], [0.025, 0.975])
                plain += low <= truth <= high
            interval = wilson_interval(ours, num_sets)
            print(
                f"{name:<14}{temperature:4.1f}{truth:8.4f}{plain / num_sets:8.3f}{ours / num_sets:7.3f}"
                f"   {interval[0]:.3f}-{interval[1]:.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
