r"""The smooth calibration error smECE of Błasiok and Nakkiran (2023, arXiv 2309.12236): no bins, no choices.

Bins jump: a confidence that moves by 1e-9 over an edge changes the binned error. Instead, the gaps confidence - correct
are smeared out along the confidence axis by a Gaussian of width σ, reflected at 0 and 1 so that nothing leaks out,

    r_σ(t) = mean over rows of  K_σ(t, confidence) · (confidence - correct),        smECE_σ = ∫₀¹ |r_σ(t)| dt,

and the width is the size of the error itself: smECE is the σ with smECE_σ = σ, the only one, as smECE_σ does not rise
with σ. It is within constant factors of the distance to the nearest perfectly calibrated predictor.

Smearing with reflection is diffusion on [0, 1]: in the basis cos(πkt) it multiplies by exp(-π²k²σ²/2). So gaps are put
on a fine grid (each shared between its two neighbours), and one cosine transform serves all widths.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dct
from scipy.optimize import brentq

from belief.metrics.inputs import checked_pair, top_label
from belief.problem import Floats

_CELLS_PER_WIDTH = 32
_CELLS = (2**11, 2**13, 2**15, 2**17)  # coarsest first: most errors are large, and want no finer grid


def smooth_calibration_error(probs: ArrayLike, labels: ArrayLike) -> float:
    """Smooth calibration error of the top shape, in [0, 1]; continuous in the confidences.

    Positive by chance for a calibrated model, as all of them. Right to a relative 1e-4 down to 2.4e-4; below, the width
    stays there and what is returned is too small by less than that.

    Args:
        probs: ``(n, K)``.
        labels: ``(n,)``.

    Raises:
        ValueError: rows that are no distributions, labels out of range, nothing at all.

    >>> round(smooth_calibration_error([[0.9, 0.1], [0.9, 0.1]], [0, 1]), 3)     # all gaps alike: no width changes them
    0.4
    """
    p, y = checked_pair(probs, labels)
    confidence, correct = top_label(p, y)
    gaps = (confidence - correct) / len(y)
    widest = 2.0  # no error reaches this
    for num_cells in _CELLS:
        transform, least = _transform(confidence, gaps, num_cells), _CELLS_PER_WIDTH / num_cells
        error = _smoothed(least, transform)
        if error >= least:
            return min(
                1.0, float(brentq(lambda width, t: _smoothed(width, t) - width, least, widest, args=(transform,)))
            )
        widest = 2.0 * least  # the fixed point is below `least`; twice that is safe against the coarser grid's error
    return error


def _transform(confidence: Floats, gaps: Floats, num_cells: int) -> Floats:
    """Coefficients Σ gap · cos(πk confidence) for k = 0 … num_cells, of gaps put on the grid."""
    cell = np.minimum((confidence * num_cells).astype(np.int64), num_cells - 1)
    upper = gaps * (confidence * num_cells - cell)
    grid = np.bincount(cell, gaps - upper, num_cells + 1) + np.bincount(cell + 1, upper, num_cells + 1)
    counted = np.concatenate([grid[:1], grid[1:-1] / 2.0, grid[-1:]])  # the transform counts inner points twice
    return np.asarray(dct(counted, type=1))


def _smoothed(width: float, transform: Floats) -> float:
    """∫₀¹ |r_σ(t)| dt by the trapezoid rule, on as many points as the transform has coefficients."""
    damping = np.exp(-0.5 * np.square(np.pi * width * np.arange(len(transform))))
    heights = np.abs(dct(transform * damping, type=1))
    return float((heights.sum() - (heights[0] + heights[-1]) / 2.0) / (len(heights) - 1))
