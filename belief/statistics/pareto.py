"""Pareto fronts of configurations that each have a cost and a success rate.

One configuration dominates another if it costs no more and achieves no less, and is better in one of the two. The
Pareto front is the set of configurations that no other dominates.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.validation import Floats, checked_values


def pareto_front(costs: ArrayLike, qualities: ArrayLike) -> NDArray[np.bool_]:
    """Mask of the Pareto front of C configurations.

    Equal configurations do not dominate each other.

    Args:
        costs: less is better, ``(..., C)``, C ≥ 1.
        qualities: more is better, ``(..., C)``.

    Returns:
        ``(..., C)``, true on the front.

    Raises:
        ValueError: no configurations, shapes that differ, values not finite or beyond ±1e150.

    >>> pareto_front([1.0, 2.0, 3.0], [0.8, 0.7, 0.9]).tolist()     # the second costs more and achieves less
    [True, False, True]
    """
    c, q = _checked(costs, qualities)
    order = np.lexsort((-q, c), axis=-1)  # by cost, then by descending quality
    c, q = np.take_along_axis(c, order, -1), np.take_along_axis(q, order, -1)
    is_dearer = np.concatenate([np.ones_like(c[..., :1], bool), c[..., 1:] > c[..., :-1]], axis=-1)
    start = np.maximum.accumulate(np.where(is_dearer, np.arange(c.shape[-1]), 0), axis=-1)  # of equal cost
    best_so_far = np.concatenate([np.full_like(q[..., :1], -np.inf), np.maximum.accumulate(q, axis=-1)], axis=-1)
    best_of_cheaper = np.take_along_axis(best_so_far, start, -1)
    on_front = (q > best_of_cheaper) & (q == np.take_along_axis(q, start, -1))
    result = np.empty_like(on_front)
    np.put_along_axis(result, order, on_front, -1)
    return result


def _checked(costs: ArrayLike, qualities: ArrayLike) -> tuple[Floats, Floats]:
    c, q = checked_values("costs", costs), checked_values("qualities", qualities)
    if c.shape != q.shape or c.ndim == 0 or c.size == 0:
        raise ValueError(f"need a cost and a quality of at least one configuration, got shapes {c.shape} and {q.shape}")
    return c, q
