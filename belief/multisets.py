"""Multisets of shapes that can be drawn from a bag, numbered by size, with their neighbours.

A multiset states how many objects of each shape were drawn. Sums over arrangements go from the multisets of i objects
to those of i + 1: a table gives the index of the multiset with one more, or one less, of each shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from belief.validation import Floats


@dataclass(frozen=True, eq=False)
class Layer:
    """The S multisets of one size.

    Attributes:
        used: objects of each shape, ``(K, S)``.
        last: largest shape in each, ``(S,)``.
        smaller: index of the multiset with one object of the shape less, ``(K, S)``; one past the end if it has none.
        bigger: index of the multiset with one object of the shape more, ``(K, S)``; one past the end if the bag has no
            more of them.
        num_bigger: number of multisets in the next layer.
        log_draws: log of the number of ordered draws of distinguishable objects, ``(S,)``: c (c - 1) … (c - u + 1) for
            u objects out of c, multiplied over shapes.
    """

    used: NDArray[np.integer]
    last: NDArray[np.int32]
    smaller: NDArray[np.int32]
    bigger: NDArray[np.int32]
    num_bigger: int
    log_draws: Floats


def layers(counts: tuple[int, ...], num_objects: int) -> list[Layer]:
    """The multisets of 0, 1, … ``num_objects`` objects from a bag with these counts."""
    return [_layer(counts, size) for size in range(num_objects + 1)]  # ascending, as each uses the cached one before


@lru_cache(maxsize=64)
def num_multisets(counts: tuple[int, ...], num_objects: int, limit: int) -> int:
    """Number of multisets of at most ``num_objects`` objects; any number above ``limit`` if there are more."""
    by_size = np.ones(1, np.int64)
    for count in counts:
        kinds = np.convolve(by_size, np.ones(min(count, num_objects) + 1, np.int64))
        by_size = np.minimum(kinds[: num_objects + 1], limit + 1)  # further shapes only increase the number
    return int(by_size.sum())


@lru_cache(maxsize=64)
def _layer(counts: tuple[int, ...], size: int) -> Layer:
    shapes, capacity = np.arange(len(counts), dtype=np.int32)[:, None], np.array(counts)[:, None]
    if size == 0:
        used = np.zeros((len(counts), 1), np.min_scalar_type(max(counts)))
        last, parent = np.zeros(1, np.int32), np.zeros(1, np.intp)
        smaller = np.zeros((len(counts), 1), np.int32)
        log_draws = np.zeros(1)
    else:
        before = _layer(counts, size - 1)
        # Each multiset is made once, from the one without its largest shape.
        last_shape, parent = np.nonzero((shapes >= before.last) & (before.used < capacity))
        last = last_shape.astype(np.int32)
        used = before.used[:, parent]
        log_draws = before.log_draws[parent] + np.log(capacity[last, 0] - used[last, np.arange(len(last))])
        used[last, np.arange(len(last))] += 1
        smaller = np.full(used.shape, before.used.shape[1], np.int32)
        shape, old = np.nonzero(before.bigger < before.num_bigger)
        smaller[shape, before.bigger[shape, old]] = old
    canonical = (shapes >= last) & (used < capacity)
    num_bigger = int(canonical.sum())
    bigger = np.full(used.shape, num_bigger, np.int32)
    bigger[canonical] = np.arange(num_bigger)
    if size > 0:
        # Add a shape below the largest: remove the largest, add the shape, add the largest again.
        other = before.bigger[:, parent]
        shape, here = np.nonzero((shapes < last) & (other < len(last)))
        bigger[shape, here] = bigger[last[here], other[shape, here]]
    return Layer(used, last, smaller, bigger, num_bigger, log_draws)
