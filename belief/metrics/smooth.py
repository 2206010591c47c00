r"""The smooth calibration error smECE of Błasiok and Nakkiran (2023, arXiv 2309.12236), which has no bins.

The gaps (confidence - correct) are smoothed over the confidence axis by a Gaussian kernel of width σ, reflected at both
ends. The width is the error itself: smECE is the unique σ with smECE_σ = σ.

    r_σ(t) = mean over rows of  K_σ(t, confidence) · (confidence - correct),        smECE_σ = ∫₀¹ |r_σ(t)| dt

Reflected smoothing multiplies the coefficient of cos(πkt) by exp(-π²k²σ²/2). The gaps are therefore interpolated onto a
fine grid, and one cosine transform is used for all widths.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dct
from scipy.optimize import brentq

from belief.metrics.binned import top_label
from belief.validation import Floats, checked_pair

_CELLS_PER_WIDTH = 32
_CELLS = (2**11, 2**13, 2**15, 2**17)  # coarsest first; large errors need no finer grid


def smooth_calibration_error(probs: ArrayLike, labels: ArrayLike) -> float:
    """Smooth calibration error of the top shape of ``probs (n, K)`` for ``labels (n,)``, in [0, 1].

    It is positive by chance for a calibrated model. The relative error is 1e-4 for results down to 2.4e-4; smaller
    results have an absolute error below 2.4e-4. Errors are those of :func:`~belief.validation.checked_pair`.

    >>> round(smooth_calibration_error([[0.9, 0.1], [0.9, 0.1]], [0, 1]), 3)     # equal gaps
    0.4
    """
    p, y = checked_pair(probs, labels)
    confidence, correct = top_label(p, y)
    gaps = (confidence - correct) / len(y)
    widest = 2.0  # above any error
    for num_cells in _CELLS:
        transform, least = _transform(confidence, gaps, num_cells), _CELLS_PER_WIDTH / num_cells
        error = _smoothed(least, transform)
        if error >= least:
            return min(
                1.0, float(brentq(lambda width, t: _smoothed(width, t) - width, least, widest, args=(transform,)))
            )
        widest = 2.0 * least  # the root is below `least`, up to the error of this grid
    return error


def _transform(confidence: Floats, gaps: Floats, num_cells: int) -> Floats:
    """Coefficients Σ gap · cos(πk confidence) for k = 0 … num_cells, of gaps put on the grid."""
    cell = np.minimum((confidence * num_cells).astype(np.int64), num_cells - 1)
    upper = gaps * (confidence * num_cells - cell)
    grid = np.bincount(cell, gaps - upper, num_cells + 1) + np.bincount(cell + 1, upper, num_cells + 1)
    counted = np.concatenate([grid[:1], grid[1:-1] / 2.0, grid[-1:]])  # dct counts inner points twice
    return np.asarray(dct(counted, type=1))


def _smoothed(width: float, transform: Floats) -> float:
    """∫₀¹ |r_σ(t)| dt by the trapezoid rule, on as many points as there are coefficients."""
    damping = np.exp(-0.5 * np.square(np.pi * width * np.arange(len(transform))))
    heights = np.abs(dct(transform * damping, type=1))
    return float((heights.sum() - (heights[0] + heights[-1]) / 2.0) / (len(heights) - 1))
