"""Which shape sits where, when no two objects share a shape: exact marginals over all arrangements.

With N objects and K ≥ N distinct shapes an arrangement is an injective map from objects to shapes. Its weight is
the product of the objects' likelihoods, and each object's marginal is a ratio of matrix permanents. There are K!
arrangements but only 2^K sets of used shapes, and the sets are all a sum over arrangements has to remember:

    forward[i][S]  = total weight of placing the first i objects on exactly the shapes of S,
    backward[i][S] = total weight of placing objects i..N-1 on shapes outside S.

That is K·2^(K-1) terms a pass instead of K!. Sinkhorn balancing would be cheaper and wrong by 0.1 to 0.2.

    >>> import numpy as np
    >>> likelihoods = np.array([[0.9, 0.1], [0.5, 0.5]])      # nothing was learned about the second object ...
    >>> arrangement_marginals(np.log(likelihoods)).round(3)   # ... yet it is probably not what the first one is
    array([[0.9, 0.1],
           [0.1, 0.9]])
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.errors import ImpossibleObservation
from belief.problem import Floats

MAX_SHAPES = 20


def arrangement_marginals(log_weights: ArrayLike) -> Floats:
    """Probability that each object has each shape, given that all shapes differ.

    Args:
        log_weights: log-likelihood (plus log prior, if any) of every shape for every object, ``(N, K)`` with
            N ≤ K; any finite value or -inf; a constant added to a row changes nothing.

    Returns:
        ``(N, K)``; rows sum to one, columns to at most one.

    Raises:
        ValueError: NaN or +inf, an empty array, more objects than shapes, or more than 20 shapes.
        ImpossibleObservation: no arrangement has a weight above zero.
    """
    weights = np.asarray(log_weights, np.float64)
    if weights.ndim != 2 or weights.size == 0:
        raise ValueError(f"log_weights must be (N, K) with at least one object and shape, got {weights.shape}")
    num_objects, num_shapes = weights.shape
    if num_objects > num_shapes:
        raise ValueError(f"{num_objects} objects cannot all differ in shape when there are {num_shapes} shapes")
    if num_shapes > MAX_SHAPES:
        raise ValueError(
            f"exact marginals need 2^K sets of shapes: K = {num_shapes} is above the limit of {MAX_SHAPES}"
        )
    bad = np.isnan(weights) | (weights == np.inf)
    if bad.any():
        row = int(np.argwhere(bad)[0][0])
        raise ValueError(f"log_weights in row {row} hold NaN or +inf: {weights[row].tolist()}")
    best = weights.max(axis=1, keepdims=True)
    if np.isneginf(best).any():
        row = int(np.argmax(np.isneginf(best)))
        raise ImpossibleObservation(f"object {row} has zero likelihood under every shape")
    # Differences beyond what sums over all objects can hold are as good as that limit; only a true -inf stays one.
    with np.errstate(over="ignore"):
        least = -np.finfo(float).max / (8 * num_objects)
        weights = np.where(np.isneginf(weights), -np.inf, np.maximum(weights - best, least))

    # forward[i]: (number of sets with i shapes,)
    forward = [np.zeros(1)]
    for i in range(num_objects):
        smaller, added = _layer(num_shapes, i + 1)
        forward.append(np.logaddexp.reduce(forward[i][smaller] + weights[i][added], axis=1))
    log_total = np.logaddexp.reduce(forward[-1])
    if np.isneginf(log_total):
        raise ImpossibleObservation(
            "no arrangement of distinct shapes has a weight above zero: two objects can only be the same shape. "
            f"log_weights: {np.asarray(log_weights).tolist()}"
        )

    marginals = np.empty_like(weights)
    backward = np.zeros(forward[-1].size)
    for i in reversed(range(num_objects)):
        smaller, added = _layer(num_shapes, i + 1)
        # Each (set of i + 1 shapes, member k) is "the first i objects on the rest, object i on k".
        log_terms = forward[i][smaller] + weights[i][added] + backward[:, None] - log_total
        marginals[i] = np.bincount(added.ravel(), np.exp(log_terms).ravel(), minlength=num_shapes)
        by_smaller = np.full((forward[i].size, num_shapes), -np.inf)
        by_smaller[smaller, added] = weights[i][added] + backward[:, None]
        backward = np.logaddexp.reduce(by_smaller, axis=1)
    return marginals / marginals.sum(axis=1, keepdims=True)


@lru_cache(maxsize=64)
def _layer(num_shapes: int, size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For every set of ``size`` shapes and each of its members: the index of the set without it, and the member.

    Both ``(num_sets, size)``; sets of a size are numbered in the order of their bit masks.
    """
    masks, smaller_masks = _masks(num_shapes, size), _masks(num_shapes, size - 1)
    members = np.nonzero((masks[:, None] >> np.arange(num_shapes)) & 1)[1].reshape(len(masks), size)
    return np.searchsorted(smaller_masks, masks[:, None] ^ (1 << members)), members


@lru_cache(maxsize=64)
def _masks(num_shapes: int, size: int) -> NDArray[np.int64]:
    every = np.arange(1 << num_shapes)
    return every[np.bitwise_count(every) == size]
