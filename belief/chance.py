"""Keyed chance: what an episode draws depends on its seed and on what is drawn, not on what was drawn before.

Two deciders that touch the same object of the same episode in the same pose, equally often, therefore feel the same
thing, be it in a search, in an environment or from a recording (decision 0007).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Keep the streams of an episode apart; never zero, because a seed ending in zeros equals the one without them.
_TOUCHING, _ARRANGING = 1, 2


def touch_rng(seed: Sequence[int], object_index: int, pose: int, repeat: int) -> np.random.Generator:
    """Source of chance of one touch: of an object in a pose, for the ``repeat``-th time (from 0).

    >>> touch_rng((7,), 0, 2, 0).random() == touch_rng((7,), 0, 2, 0).random()
    True
    """
    return np.random.default_rng([*seed, _TOUCHING, object_index, pose, repeat])


def arrangement_rng(seed: Sequence[int]) -> np.random.Generator:
    """Source of chance of an episode's objects: which shapes lie where, their sizes and orientations.

    >>> int(arrangement_rng((7, 0)).integers(100)) != int(arrangement_rng((7, 1)).integers(100))
    True
    """
    return np.random.default_rng([*seed, _ARRANGING])
