"""Pareto fronts of configurations that each have a cost and a success rate.

One configuration dominates another if it costs no more and achieves no less, and is better in one of the two. What no
other dominates forms the Pareto front: the offers among which a choice is a matter of taste.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.problem import Floats
from belief.statistics.inputs import checked_values


def pareto_front(costs: ArrayLike, qualities: ArrayLike) -> NDArray[np.bool_]:
    """Which of C configurations no other dominates.

    Equal configurations do not dominate each other. Takes C log C comparisons.

    Args:
        costs: less is better, ``(..., C)``, C ≥ 1.
        qualities: more is better, ``(..., C)``.

    Returns:
        ``(..., C)``, true on the front; every front has one member at least.

    Raises:
        ValueError: no configurations, shapes that differ, values not finite or beyond ±1e150.

    >>> pareto_front([1.0, 2.0, 3.0], [0.8, 0.7, 0.9]).tolist()     # the second costs more and achieves less
    [True, False, True]
    """
    c, q = _checked(costs, qualities)
    order = np.lexsort((-q, c), axis=-1)  # by cost, the best of equal cost first
    c, q = np.take_along_axis(c, order, -1), np.take_along_axis(q, order, -1)
    is_dearer = np.concatenate([np.ones_like(c[..., :1], bool), c[..., 1:] > c[..., :-1]], axis=-1)
    start = np.maximum.accumulate(np.where(is_dearer, np.arange(c.shape[-1]), 0), axis=-1)  # of those of equal cost
    best_so_far = np.concatenate([np.full_like(q[..., :1], -np.inf), np.maximum.accumulate(q, axis=-1)], axis=-1)
    best_of_cheaper = np.take_along_axis(best_so_far, start, -1)
    on_front = (q > best_of_cheaper) & (q == np.take_along_axis(q, start, -1))
    result = np.empty_like(on_front)
    np.put_along_axis(result, order, on_front, -1)
    return result


def pareto_probabilities(cost_samples: ArrayLike, quality_samples: ArrayLike) -> Floats:
    """How often each configuration is on the front, over samples of what all of them truly cost and achieve.

    The samples are, for instance, means over bootstrap resamples of episodes, the same episodes for all configurations.

    Args:
        cost_samples: ``(S, C)``, S ≥ 1 samples of C ≥ 1 configurations.
        quality_samples: ``(S, C)``, from the same resamples.

    Returns:
        ``(C,)``, in [0, 1]; sums to one at least.

    Raises:
        ValueError: empty, shapes that differ, values not finite or beyond ±1e150.

    >>> pareto_probabilities([[1.0, 2.0], [1.0, 2.0]], [[0.8, 0.9], [0.8, 0.7]]).tolist()
    [1.0, 0.5]
    """
    c, q = _checked(cost_samples, quality_samples)
    if c.ndim != 2:
        raise ValueError(f"need samples (S, C), got shape {c.shape}")
    return np.asarray(pareto_front(c, q).mean(axis=0))


def _checked(costs: ArrayLike, qualities: ArrayLike) -> tuple[Floats, Floats]:
    c, q = checked_values("costs", costs), checked_values("qualities", qualities)
    if c.shape != q.shape or c.ndim == 0 or c.size == 0:
        raise ValueError(f"need a cost and a quality of at least one configuration, got shapes {c.shape} and {q.shape}")
    return c, q
