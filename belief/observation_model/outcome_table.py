"""Outcome tables: discrete observation models; and how a continuous model becomes one.

Touches are clustered by their posterior under a uniform prior, by k-means with the Kullback-Leibler divergence. Its
objective is the mutual information of touch and shape that is lost (Dhillon, Mallela & Kumar 2003).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.bayes import expected_information_gain
from belief.frozen import FrozenArrays
from belief.validation import SUM_TOLERANCE, Floats, as_real, renormalised


def require_distributions(probs: Floats, place: Callable[..., str]) -> None:
    """Check that the last axis of probs sums to one; ``place`` has words for the other indices of what does not."""
    with np.errstate(over="ignore", invalid="ignore"):
        totals = probs.sum(axis=-1)
    wrong = np.argwhere(~((probs >= 0.0).all(axis=-1) & (np.abs(totals - 1.0) <= SUM_TOLERANCE)))
    for index in wrong[:1].tolist():
        hint = "; divide percentages by 100" * bool(abs(totals[*index] / 100.0 - 1.0) <= SUM_TOLERANCE)
        if probs.ndim >= 3 and (probs >= 0.0).all() and (np.abs(probs.sum(axis=1) - 1.0) <= SUM_TOLERANCE).all():
            hint = "; the second axis sums to one, so swap it with the last: np.swapaxes(probs, 1, -1)"
        raise ValueError(f"probs[{place(*index)}] is no distribution over outcomes: {probs[*index].tolist()}{hint}")


@dataclass(frozen=True, eq=False)
class OutcomeTable(FrozenArrays):
    """A discrete observation model.

    Attributes:
        probs: p(outcome | pose, shape), ``(P, K, M)``; the last axis sums to one.

    Raises:
        ValueError: not real numbers, not three axes, a negative or NaN entry, or a row that does not sum to one.

    Example:
        >>> table = OutcomeTable(np.array([[[0.9, 0.1], [0.1, 0.9]]]))
        >>> table.num_poses, table.num_shapes, table.num_outcomes
        (1, 2, 2)
        >>> table.information().round(3)                  # at most log 2 = 0.693 nats
        array([0.368])
    """

    probs: Floats

    def __post_init__(self) -> None:
        probs = np.array(as_real(self.probs, "probs"), np.float64)
        if probs.ndim != 3 or probs.size == 0:
            raise ValueError(f"probs must be (P, K, M) with no axis empty, got shape {probs.shape}")
        require_distributions(probs, lambda pose, shape: f"pose {pose}, shape {shape}")
        probs = renormalised(probs)
        probs.flags.writeable = False  # already a copy
        object.__setattr__(self, "probs", probs)

    @property
    def num_poses(self) -> int:
        """P."""
        return self.probs.shape[0]

    @property
    def num_shapes(self) -> int:
        """K."""
        return self.probs.shape[1]

    @property
    def num_outcomes(self) -> int:
        """M."""
        return self.probs.shape[2]

    @property
    def sha256(self) -> str:
        """SHA-256 of the table's shape and numbers."""
        content = np.ascontiguousarray(self.probs, "<f8").tobytes()
        return hashlib.sha256(repr(self.probs.shape).encode() + content).hexdigest()

    def information(self, prior: ArrayLike | None = None) -> Floats:
        """Mutual information of one touch and the shape, in each pose [nats], ``(P,)``; uniform prior by default."""
        belief = np.full(self.num_shapes, 1.0 / self.num_shapes) if prior is None else prior
        return expected_information_gain(belief, self.probs)


_CLUSTERED = 20_000  # most touches from which clusters are computed
_SMOOTHING = 0.1  # pseudo-touches, spread over all outcomes, so that none is impossible


def merged(table: OutcomeTable, num_outcomes: int, rng: np.random.Generator) -> OutcomeTable:
    """A table of at most ``num_outcomes`` outcomes: those with similar posteriors are merged, the same in all poses."""
    if table.num_outcomes <= num_outcomes:
        return table
    shares = np.swapaxes(table.probs, 1, 2)  # (P, M, K)
    posteriors = np.maximum(shares, np.finfo(float).tiny)
    posteriors = posteriors / posteriors.sum(axis=2, keepdims=True)
    return OutcomeTable(tabulate(np.log(posteriors), shares, num_outcomes, rng))


def drawn(weights: Floats, poses: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
    """One of the N representative touches in a pose, drawn by weights ``(P, N)``, for every entry of ``poses``."""
    cumulative, found = weights.cumsum(axis=1), np.empty(poses.shape, np.int64)
    for pose in np.unique(poses).tolist():
        here = poses == pose
        found[here] = np.searchsorted(cumulative[pose], rng.random(here.sum()) * cumulative[pose, -1], "right")
    return np.minimum(found, weights.shape[1] - 1)


def tabulate(log_posteriors: Floats, shares: Floats, num_outcomes: int, rng: np.random.Generator) -> Floats:
    """p(outcome | pose, shape), ``(P, K, M)``, of N touches per pose, clustered by posterior under a uniform prior.

    A touch counts for every shape with its posterior weight, not for the shape it was sampled from, so sampling noise
    adds no information. ``log_posteriors`` and the weights ``shares``, which sum to one over N, are ``(P, N, K)``.
    """
    every = log_posteriors.reshape(-1, log_posteriors.shape[2])
    some = every if len(every) <= _CLUSTERED else every[rng.choice(len(every), _CLUSTERED, replace=False)]
    centroids = cluster(some, num_outcomes, rng)
    tables = np.empty((len(shares), shares.shape[2], num_outcomes))
    for table, posteriors, share in zip(tables, log_posteriors, shares, strict=True):  # one pose at a time fits memory
        outcomes = nearest(posteriors, centroids)  # (N,)
        table[:] = share.T @ (outcomes[:, None] == np.arange(num_outcomes)).astype(np.float64)
    return tables


def smoothed(table: Floats, num_touches: ArrayLike) -> Floats:
    """A table ``(..., M)`` of ``num_touches`` touches with 0.1 pseudo-touches spread over all outcomes."""
    number = np.asarray(num_touches, np.float64)
    return np.asarray((number * table + _SMOOTHING / table.shape[-1]) / (number + _SMOOTHING))


def cluster(log_posteriors: Floats, num_clusters: int, rng: np.random.Generator, num_rounds: int = 30) -> Floats:
    """Log of cluster means ``(M, K)`` of posteriors ``(n, K)``, by KL-divergence k-means++; some may be empty."""
    probs = np.exp(log_posteriors)
    own = (probs * np.maximum(log_posteriors, _FLOOR)).sum(axis=1)
    centroids = log_posteriors[rng.integers(len(probs))][None]
    distance = np.full(len(probs), np.inf)
    for _ in range(num_clusters - 1):
        distance = np.minimum(distance, np.maximum(own - probs @ np.maximum(centroids[-1], _FLOOR), 0.0))
        total = distance.sum()
        pick = rng.choice(len(probs), p=distance / total) if total > 0.0 else rng.integers(len(probs))
        centroids = np.concatenate([centroids, log_posteriors[pick][None]])
    for _ in range(num_rounds):
        assigned = nearest(log_posteriors, centroids)
        sizes = np.bincount(assigned, minlength=num_clusters)
        sums = np.stack([np.bincount(assigned, p, minlength=num_clusters) for p in probs.T], axis=1)
        means = np.log(np.maximum(sums, np.exp(_FLOOR)) / np.maximum(sizes, 1)[:, None])
        updated = np.where(sizes[:, None] > 0, means, centroids)
        if np.array_equal(updated, centroids):
            break
        centroids = updated
    return centroids


def nearest(log_posteriors: Floats, centroids: Floats) -> np.ndarray:
    """Index of the centroid with the least Kullback-Leibler divergence from each posterior, ``(...)``."""
    return np.asarray((np.exp(log_posteriors) @ np.maximum(centroids, _FLOOR).T).argmax(axis=-1))


_FLOOR = -700.0  # smallest logarithm whose exponential is not subnormal
