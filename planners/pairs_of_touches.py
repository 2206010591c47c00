"""What the next two touches of an object tell together, for choices where no single touch tells anything."""

from __future__ import annotations

import numpy as np
from scipy.special import entr

from belief.observation_model.outcome_mixture import Outcomes
from belief.problem import Floats

_CANDIDATES = 8  # first poses that are looked into


def best_pairs(mixture: Outcomes, belief: Floats, target: int, alone: Floats, candidates: int = _CANDIDATES) -> Floats:
    """Information about "this is the target" in the best pair of touches that begins in each pose [nats], ``(P,)``.

    Two touches can tell what neither tells alone: the first may show how the object lies, and so what the second means.

    Args:
        mixture: outcomes of the next touches.
        belief: about the shape, ``(K,)``.
        target: index of the target.
        alone: gain of a single touch in each pose, ``(P,)``, a lower bound. The poses with the largest, evenly spread
            among equals, are looked into; for the others the lower bound is returned.
        candidates: how many.
    """
    found = alone.copy()
    factors = np.stack([np.where(np.arange(len(belief)) == target, belief, 0.0), belief])
    prior = entr([belief[target], 1.0 - belief[target]]).sum()
    order = np.argsort(-alone, kind="stable")
    level = order[alone[order] >= alone.max() - 1e-6]
    chosen = level[np.linspace(0, len(level) - 1, candidates).astype(int)] if len(level) > candidates else order
    for pose in np.unique(chosen[:candidates]).tolist():
        hit, both = mixture.two_touches(pose, factors)  # (M, P, M) each
        left = entr(hit) + entr(np.maximum(both - hit, 0.0)) - entr(both)
        found[pose] = max(found[pose], float(prior - left.sum(axis=(0, 2)).min()))
    return found
