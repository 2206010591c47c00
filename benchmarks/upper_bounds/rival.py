"""Upper bounds on the value for one object that is the target or one known rival.

The belief is one number p = p(target). Value iteration over a grid of p, with interpolation between its points, gives
an upper bound, because the value is convex; every iterate is one.
"""

from __future__ import annotations

import numpy as np

from belief.validation import Floats

from .touch_costs import TouchCosts

INTERVALS = 100
"""Of the grid of p(target), whose G points are one more."""
_MAX_SWEEPS = 300
_TOLERANCE = 1e-6


def pair_steps(table: Floats) -> Floats:
    """Matrices that turn values on the grid of p(target) into their expectation after a touch, ``(P, G, G)``.

    Args:
        table: p(outcome | pose, shape) of the target and its rival, ``(P, 2, M)``.
    """
    grid = np.linspace(0.0, 1.0, INTERVALS + 1)
    target, rival = grid[:, None] * table[:, 0, None], (1.0 - grid)[:, None] * table[:, 1, None]  # (P, G, M)
    chance = target + rival
    place = INTERVALS * target / np.maximum(chance, np.finfo(float).tiny)
    low = np.minimum(place.astype(np.int64), INTERVALS - 1)
    steps, (pose, start, _) = np.zeros((len(table), len(grid), len(grid))), np.indices(low.shape)
    np.add.at(steps, (pose, start, low), chance * (1.0 - (place - low)))
    np.add.at(steps, (pose, start, low + 1), chance * (place - low))
    return steps


def pair_values(steps: Floats, payoffs: Floats, costs: TouchCosts) -> Floats:
    """Upper bounds on the value on the grid of p(target), ``(G,)``, if every touch shows an outcome.

    Args:
        steps: from :func:`pair_steps`.
        payoffs: of CONFIRM and REJECT for the target and its rival, ``(2, 2)``.
        costs: of touches; their weights are not used, because a touch without an outcome is worth less.
    """
    grid = np.linspace(0.0, 1.0, INTERVALS + 1)
    beliefs = np.stack([grid, 1.0 - grid], axis=1)
    stop = (beliefs @ payoffs.T).max(axis=1)
    value = np.maximum(stop, beliefs @ costs.known(payoffs) * costs.discount - costs.cost)
    for _ in range(_MAX_SWEEPS):
        before = value
        value = np.minimum(np.maximum(stop, costs.discount * (steps @ value).max(axis=0) - costs.cost), value)
        if (before - value).max() < _TOLERANCE:
            break
    return value
