r"""How far each direction of evidence repeats, where one correlation for all of them is too coarse.

What tells a sphere from a cube may be the same at every touch of a face, and what tells a cube from a cone new each
time. With a matrix R in place of ρ, n touches in one pose, whose log ratios are e on average, are worth

    n (I + (n - 1) R)⁻¹ e,

the law of :func:`~belief.observation_model.repeat_discount.effective_touches` where R = ρ I. It is generalised least
squares
again: if the log ratios of two touches have covariance G each and H between them, then R = H G⁻¹.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from scipy.special import log_softmax

from belief.observation_model.repeat_discount import Repeats
from belief.problem import Floats

_SHRINKAGE = 10.0  # weight of ρ I in R, in groups of touches
_LARGEST = 1e290  # of a log ratio, so that sums of them stay finite
_LARGEST_PART = 0.999  # of a direction's evidence, that touches share


def centred(log_ratio: Floats) -> Floats:
    """Log ratios ``(..., K)`` less their mean over shapes, which says nothing, and none of them beyond all bounds.

    >>> centred(np.array([3.0, 1.0, -1.0])).tolist()
    [2.0, 0.0, -2.0]
    """
    bounded = np.clip(log_ratio, -_LARGEST, _LARGEST)
    return np.asarray(bounded - (bounded / bounded.shape[-1]).sum(axis=-1, keepdims=True))


def discounts(num_touches: ArrayLike, directions: Floats) -> Floats:
    """The matrices that turn *sums* of n log ratios into what they are worth, ``(..., K, K)`` for n ``(...)``.

    >>> discounts([1, 3], 0.5 * np.eye(2)).diagonal(axis1=1, axis2=2)
    array([[1. , 1. ],
           [0.5, 0.5]])
    """
    n = np.asarray(num_touches, np.float64)[..., None, None]
    identity = np.eye(len(directions))
    return np.asarray(np.linalg.inv(identity + np.maximum(n - 1.0, 0.0) * directions))


def fit_directions(log_ratio: Floats, found: Repeats, correlation: float) -> Floats:
    """The matrix R ``(K, K)`` under which groups of repeated touches predict best which of their shapes they are of.

    Its eigenvalues have real parts in [0, 1), so every number of touches has a worth.

    Args:
        log_ratio: of every touch, by a calibration that did not see its object, ``(n, K)``.
        found: the groups, see :func:`~belief.observation_model.repeat_discount.repeats`.
        correlation: ρ; the fewer groups, the nearer R is to ρ I.

    Touches that come twice are worth one, and R says so about the one direction that tells two shapes apart:

    >>> rng, shapes = np.random.default_rng(0), np.arange(1000) % 2
    >>> log_ratio = (2.0 * np.eye(2)[shapes] + np.sqrt(2.0) * rng.normal(size=(1000, 2))).repeat(2, axis=0)
    >>> pairs = Repeats(np.arange(2000).reshape(1000, 2), shapes)
    >>> directions = fit_directions(log_ratio, pairs, correlation=0.5)
    >>> bool(np.array([1.0, -1.0]) @ directions @ [1.0, -1.0] / 2.0 > 0.8)
    True
    """
    num_shapes, longest = log_ratio.shape[1], found.rows.shape[1]
    inside = found.rows >= 0
    sums = np.where(inside[..., None], centred(log_ratio)[found.rows], 0.0).cumsum(axis=1).swapaxes(0, 1)[1:]
    counted = inside.T[1:, :, None] / inside[:, 1:].sum()  # weight of each beginning of a group, (n - 1, G, 1)
    # As in fit_correlation, shapes of no group do not compete.
    unseen = np.where(np.isin(np.arange(num_shapes), found.shapes), 0.0, -np.inf)
    truth = np.eye(num_shapes)[found.shapes]
    strength, start = _SHRINKAGE / len(found.rows), correlation * np.eye(num_shapes)
    further = np.arange(1, longest)[:, None, None]  # touches beyond the first

    def loss(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        directions = flat.reshape(start.shape)
        matrices = discounts(np.arange(2, longest + 1), directions)
        log_probs = log_softmax(sums @ matrices.swapaxes(1, 2) + unseen, axis=2)
        slopes = (counted * (np.exp(log_probs) - truth)).swapaxes(1, 2) @ sums
        transposed = matrices.swapaxes(1, 2)
        away = directions - start
        value = -float((counted * np.where(truth > 0.0, log_probs, 0.0)).sum()) + strength * float((away**2).sum())
        gradient = 2.0 * strength * away - (further * (transposed @ slopes @ transposed)).sum(axis=0)
        return value, gradient.ravel()

    best = minimize(loss, start.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": 200})
    return _bounded(best.x.reshape(start.shape))


def _bounded(directions: Floats) -> Floats:
    """The matrix with the real parts of its eigenvalues brought into [0, 1)."""
    values, vectors = np.linalg.eig(directions)
    kept = np.clip(values.real, 0.0, _LARGEST_PART) + 1j * values.imag
    return np.asarray((vectors * kept @ np.linalg.inv(vectors)).real)
