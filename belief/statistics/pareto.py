"""Pareto fronts of configurations that each have a cost and a success rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.validation import checked_values


def pareto_front(costs: ArrayLike, qualities: ArrayLike) -> NDArray[np.bool_]:
    """Mask of the configurations that no other dominates, ``(C,)``.

    One configuration dominates another if it costs no more and achieves no less, and is better in one of the two.

    Args:
        costs: less is better, ``(C,)``, C ≥ 1.
        qualities: more is better, ``(C,)``.

    Raises:
        ValueError: no configurations, shapes that differ, values not finite or beyond ±1e150.

    >>> pareto_front([1.0, 2.0, 3.0], [0.8, 0.7, 0.9]).tolist()     # the second costs more and achieves less
    [True, False, True]
    """
    c, q = checked_values("costs", costs), checked_values("qualities", qualities)
    if c.shape != q.shape or c.ndim != 1 or c.size == 0:
        raise ValueError(f"need a cost and a quality of at least one configuration, got shapes {c.shape} and {q.shape}")
    dearer, worse = c[:, None] - c, q - q[:, None]  # of each configuration than every other
    dominated = (dearer >= 0.0) & (worse >= 0.0) & ((dearer > 0.0) | (worse > 0.0))
    return np.asarray(~dominated.any(axis=1))
