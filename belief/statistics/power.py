"""Sample size: number of paired episodes for a significant difference.

If a fraction ψ of the episodes is discordant and the success rates differ by δ, McNemar's test at level α has the power
1 - β after

    n = (z_{α/2} √ψ + z_β √(ψ - δ²))² / δ²                                           (Connor 1987)

episodes. For a mean of paired differences with standard deviation s it is n = ((z_{α/2} + z_β) s / δ)².
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from belief.statistics.mcnemar import McNemar

LEVEL, POWER = 0.05, 0.8


def episodes_for_success(pairs: McNemar, level: float = LEVEL, power: float = POWER) -> int | None:
    """Total number of paired episodes for which McNemar's test detects the observed difference with a given power.

    The result is None if the observed difference is zero. ``level`` is the two-sided α.

    >>> from belief.statistics import mcnemar_test
    >>> episodes_for_success(mcnemar_test([True] * 97 + [False] * 3, [True] * 95 + [False] * 5))
    391
    """
    delta = abs(pairs.difference)
    if delta == 0.0:
        return None
    discordant = (pairs.first_only + pairs.second_only) / pairs.num_episodes
    return _whole((_z(level / 2) * math.sqrt(discordant) + _z(1 - power) * math.sqrt(discordant - delta**2)) / delta)


def episodes_for_mean(differences: Sequence[float], level: float = LEVEL, power: float = POWER) -> int | None:
    """Total number of paired episodes for which a test detects the observed mean difference with a given power.

    The result is None if the mean difference is zero, or for fewer than two pairs. ``level`` is the two-sided α.

    >>> episodes_for_mean([1.0, 0.0, 1.0, -1.0])
    116
    """
    mean = float(np.mean(differences))
    if mean == 0.0 or len(differences) < 2:
        return None
    return _whole((_z(level / 2) + _z(1 - power)) * float(np.std(differences, ddof=1)) / abs(mean))


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


def _z(tail: float) -> float:
    return -float(ndtri(tail))


def _whole(root: float) -> int:
    return max(math.ceil(root**2), 1)
