"""Effective number of independent touches among repeats in one pose, and the fit of their correlation."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.bayes import update
from belief.validation import Floats

if TYPE_CHECKING:
    from belief.observation_model.calibration_data import LabelledTouches

ASSUMED_CORRELATION = 0.5  # if no object was touched twice in a pose
_LARGEST = 0.999
_LONGEST = 12  # touches used of each group; limits the memory for one long group


def effective_touches(num_touches: ArrayLike, correlation: float) -> Floats:
    """Effective number of n touches in one pose with pairwise correlation ρ: n / (1 + (n - 1) ρ), at most 1/ρ.

    It is the weight of their mean in generalised least squares under equal correlation.

    >>> effective_touches([1, 2, 6], correlation=0.4).round(2)
    array([1.  , 1.43, 2.  ])
    """
    n = np.asarray(num_touches, np.float64)
    return n / (1.0 + np.maximum(n - 1.0, 0.0) * correlation)


def repeat_shares(poses: NDArray[np.int64], correlation: float, drift: float = 0.0) -> Floats:
    """Weight of each touch of sequences in ``poses (S, n)``: effective number of those in its pose, over their number.

    >>> repeat_shares(np.array([[0, 1, 0], [2, 1, 0]]), correlation=0.5).round(2).tolist()
    [[0.67, 1.0, 0.67], [1.0, 1.0, 1.0]]
    """
    keys = poses + (int(poses.max(initial=0)) + 1) * np.arange(len(poses))[:, None]
    counts = np.bincount(keys.ravel())[keys] if keys.size else keys
    shares = np.asarray(effective_touches(counts, correlation) / np.maximum(counts, 1))
    return shares * drift_share(shares.sum(axis=1, keepdims=True), drift) if drift else shares


def drift_share(num_touches: ArrayLike, drift: float) -> Floats:
    """Weight of each of n touches in different poses where the reader errs alike: 1 / (1 + (n - 1) κ)."""
    n = np.asarray(num_touches, np.float64)
    return np.asarray(1.0 / (1.0 + np.maximum(n - 1.0, 0.0) * drift))


def new_shares(num_touches: ArrayLike, correlation: float, drift: float) -> Floats:
    """By how much one more touch in each pose raises the effective number of so many in each pose, ``(..., P)``."""
    here, after = (effective_touches(np.asarray(num_touches) + more, correlation) for more in (0.0, 1.0))
    before = here.sum(axis=-1, keepdims=True)
    more = effective_touches(before - here + after, drift) - effective_touches(before, drift)
    return np.clip(more, 0.0, 1.0)


class Repeats(NamedTuple):
    """G groups of n ≤ 12 touches of an object in one pose: rows ``(G, n)``, padded with -1, and shapes ``(G,)``."""

    rows: NDArray[np.int64]
    shapes: NDArray[np.int64]


def repeats(data: LabelledTouches) -> Repeats | None:
    """The first 2 to 12 touches of each object in each pose, in groups; None if these are of fewer than two shapes."""
    _, group = np.unique(data.objects * data.num_poses + data.poses, return_inverse=True)
    order = np.argsort(group, kind="stable")
    sizes = np.bincount(group)
    first = np.concatenate([[0], sizes.cumsum()[:-1]])
    kept = np.flatnonzero(sizes > 1)
    if np.unique(data.shapes[order[first[kept]]]).size < 2:
        return None
    steps = np.arange(min(sizes.max(), _LONGEST))
    inside = steps < sizes[kept, None]
    rows = np.where(inside, order[np.minimum(first[kept, None] + steps, len(order) - 1)], -1)
    return Repeats(rows, data.shapes[rows[:, 0]])


def fit_correlation(log_likelihoods: Callable[[float], Floats], found: Repeats) -> float:
    """The ρ in [0, 1) of least negative log posterior of the true shapes, among the shapes of the groups."""
    inside = (found.rows >= 0)[:, 1:]
    seen, shapes = np.unique(found.shapes, return_inverse=True)
    truth = shapes[np.nonzero(inside)[0]]

    def loss(correlation: float) -> float:
        values = log_likelihoods(correlation)[inside][:, seen]
        log_posterior, _ = update(np.full(values.shape[1], -np.log(values.shape[1])), values)
        return -float(log_posterior[np.arange(len(values)), truth].mean())

    best = scipy.optimize.minimize_scalar(loss, bounds=(0.0, _LARGEST), method="bounded", options={"xatol": 1e-4})
    return min((0.0, float(best.x), _LARGEST), key=loss)
