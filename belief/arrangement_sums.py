"""Sums over all arrangements of shapes in plain numbers: fast, where no probability underflows.

The weight of an arrangement is a product of entries of one matrix, the likelihoods relative to the largest of each
object. For few objects (up to six of as many shapes) one table lists all arrangements: a product over objects and one
product with a matrix give all marginals. For more objects the sums go over multisets of shapes, see
:mod:`belief.arrangement`; blocks of multisets are small enough to stay in the processor's cache.

What underflows changes no result by more than :data:`_LOST`. A result is returned only if all marginals of positive
probability are far above that; otherwise the caller sums logarithms.

    >>> fast_marginals(np.log([[0.9, 0.1], [0.5, 0.5]]), (1, 1)).round(3)
    array([[0.9, 0.1],
           [0.1, 0.9]])
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from belief.multisets import Layer, layers
from belief.validation import Floats

_LOST = 1e-270
"""More than the total weight of all arrangements whose weight or partial weights underflow."""
_RELIABLE = 1e-200
"""Smallest weight that is told apart from an underflow."""
_LARGEST_TABLE = 2**17
"""Largest number of entries (object, shape, arrangement) in a table of all arrangements: six objects of six shapes."""
_BLOCK = 2048
"""Multisets per block."""


def fast_marginals(log_weights: Floats, counts: tuple[int, ...]) -> Floats | None:
    """Probability that each object has each shape, ``(N, K)``; None if some underflow, or no arrangement is possible.

    Args:
        log_weights: log-likelihoods, ``(N, K)``, finite or -inf; -inf for shapes that are not in the bag.
        counts: objects of each shape in the bag, ``(K,)``, at least N in all.
    """
    tops = log_weights.max(axis=1, keepdims=True)
    if not tops.min() > -np.inf:
        return None
    table = every_arrangement(counts, len(log_weights))
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        weights = np.exp(log_weights - tops)
        totals = _over_multisets(weights, counts) if table is None else _over_arrangements(weights, table)
        total = totals[0].sum()
        if totals.min() < _RELIABLE and not (totals[log_weights > -np.inf] >= _RELIABLE).all():
            return None
        return totals / total if total < np.inf else None


class Arrangements(NamedTuple):
    """All arrangements of N objects.

    Attributes:
        places: index of the weight of object i in arrangement a, in the flat matrix of weights, ``(N, A)``.
        draws: for every object and shape, the number of ways to draw each arrangement in which the object has the
            shape, relative to the largest; zero for the other arrangements, ``(N * K, A)``.
    """

    places: NDArray[np.intp]
    draws: Floats


@lru_cache(maxsize=64)
def every_arrangement(counts: tuple[int, ...], num_objects: int) -> Arrangements | None:
    """All arrangements of objects from a bag with these counts; None if they are too many for a table.

    >>> every_arrangement((1, 1), 2).places.tolist()      # of the weights [[0, 1], [2, 3]]
    [[1, 0], [2, 3]]
    """
    num_shapes, capacity = len(counts), np.array(counts, np.float64)
    shapes, used, draws = np.zeros((0, 1), np.intp), np.zeros((num_shapes, 1)), np.ones(1)
    for _ in range(num_objects):
        if num_objects * num_shapes * shapes.shape[1] > _LARGEST_TABLE:  # further objects only increase the number
            return None
        shape, before = np.nonzero(used < capacity[:, None])
        draws = draws[before] * (capacity[shape] - used[shape, before])
        draws /= draws.max()
        used = used[:, before]
        used[shape, np.arange(len(shape))] += 1
        shapes = np.concatenate([shapes[:, before], shape[None]])
    if num_objects * num_shapes * shapes.shape[1] > _LARGEST_TABLE:
        return None
    has = shapes[:, None] == np.arange(num_shapes)[:, None]  # (N, K, A)
    places = shapes + num_shapes * np.arange(num_objects)[:, None]
    return Arrangements(places, np.where(has, draws, 0.0).reshape(num_objects * num_shapes, -1))


def _over_arrangements(weights: Floats, table: Arrangements) -> Floats:
    """Total weight of the arrangements in which each object has each shape, ``(N, K)``."""
    factors = weights.ravel()[table.places]
    products = factors[0]
    for row in factors[1:]:  # faster than prod
        products *= row
    return np.asarray((table.draws @ products).reshape(weights.shape))


def _over_multisets(weights: Floats, counts: tuple[int, ...]) -> Floats:
    """The same by the forward-backward algorithm of :mod:`belief.arrangement`."""
    table = layers(counts, len(weights))
    forward = [np.ones(1)]
    for row, layer in zip(weights[:-1], table[1:], strict=False):
        forward.append(_step(row, forward[-1], layer.smaller))
    totals = np.empty_like(weights)
    end = table[-1].log_draws
    backward = np.exp(end - end.max())
    for i in reversed(range(len(weights))):
        backward, totals[i] = _step_and_totals(weights[i], backward, table[i], forward[i])
    return totals


def _step(row: Floats, totals: Floats, index: NDArray[np.int32]) -> Floats:
    """Sum over shapes of an object's weight times the total of the neighbour by that shape, ``(S,)``."""
    padded, found = np.append(totals, 0.0), np.empty(index.shape[1])
    for start in range(0, len(found), _BLOCK):
        block = slice(start, start + _BLOCK)
        found[block] = row @ padded.take(index[:, block])
    return found


def _step_and_totals(row: Floats, backward: Floats, layer: Layer, forward: Floats) -> tuple[Floats, Floats]:
    """:func:`_step` backwards, and the total weight of the arrangements in which the object has a shape, ``(K,)``."""
    padded, found, sums = np.append(backward, 0.0), np.empty(len(forward)), np.zeros(len(row))
    for start in range(0, len(found), _BLOCK):
        block = slice(start, start + _BLOCK)
        neighbours = padded.take(layer.bigger[:, block])
        found[block] = row @ neighbours
        sums += neighbours @ forward[block]
    return found, row * sums
