"""Sample size: number of paired episodes for a significant difference.

If a fraction ψ of the episodes is discordant and the success rates differ by δ, McNemar's test at level α has the power
1 - β after

    n = (z_{α/2} √ψ + z_β √(ψ - δ²))² / δ²                                           (Connor 1987)

episodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from belief.statistics.mcnemar import McNemar
from belief.validation import require_fraction

LEVEL, POWER = 0.05, 0.8


def episodes_for_success(pairs: McNemar, level: float = LEVEL, power: float = POWER) -> int | None:
    """Total number of paired episodes for which McNemar's test detects the observed difference with a given power.

    The result is None if the observed difference is zero. It is never so small that no outcome is significant:
    at least 5 at the default level. ``level`` is the two-sided α.

    Raises:
        InvalidArgument: ``level`` or ``power`` is not in (0, 1).
    """
    z_level, z_power = _quantiles(level, power)
    delta = abs(pairs.difference)
    if delta == 0.0:
        return None
    discordant = (pairs.first_only + pairs.second_only) / pairs.num_episodes
    fewest = math.floor(-math.log2(level)) + 1  # the mid-p value of n discordant episodes is at least 2^-n
    root = (z_level * math.sqrt(discordant) + z_power * math.sqrt(discordant - delta**2)) / delta
    return max(math.ceil(max(root, 0.0) ** 2), fewest)


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values with Holm's (1979) correction for multiple tests, which controls the family-wise error rate.

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    order = np.argsort(p_values, kind="stable")
    factors = np.arange(len(p_values), 0, -1)
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(np.maximum.accumulate(factors * np.asarray(p_values, np.float64)[order]), 1.0)
    return corrected.tolist()


def _quantiles(level: float, power: float) -> tuple[float, float]:
    """z_{α/2} and z_β."""
    require_fraction("level", level)
    require_fraction("power", power)
    return -float(ndtri(level / 2)), float(ndtri(power))
