"""McNemar's test for the success rates of two deciders on the same episodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betainc

from belief.validation import checked_outcomes


@dataclass(frozen=True)
class McNemar:
    """Outcome of :func:`mcnemar_test`.

    Attributes:
        num_episodes: n.
        first_only: episodes in which only the first was right.
        second_only: episodes in which only the second was right.
        p_value: exact and two-sided, in [0, 1].
        mid_p_value: p-value minus half the probability of the observed outcome on both sides, in [0, 1]; less
            conservative with few discordant episodes (Fagerland et al. 2013).

    >>> McNemar(num_episodes=10, first_only=3, second_only=1, p_value=0.625, mid_p_value=0.375).difference
    0.2
    """

    num_episodes: int
    first_only: int
    second_only: int
    p_value: float
    mid_p_value: float

    @property
    def difference(self) -> float:
        """Success rate of the first minus that of the second, in [-1, 1]."""
        return (self.first_only - self.second_only) / self.num_episodes


def mcnemar_test(first_correct: ArrayLike, second_correct: ArrayLike) -> McNemar:
    """Exact test of equal success rates on the same episodes, from booleans or 0 and 1, ``(n,)``, in the same order.

    Under equal rates, the b + c episodes in which only one decider was right split as tosses of a fair coin, so the
    p-value is that of a binomial test.

    Returns:
        Discordant counts and p-values; p = 1 without discordant episodes.

    Raises:
        ValueError: empty, of different lengths, or other values than 0 and 1.

    >>> result = mcnemar_test([1, 1, 1, 1, 1, 1, 0, 0], [0, 0, 0, 0, 0, 0, 1, 0])
    >>> result.first_only, result.second_only, result.p_value, round(result.mid_p_value, 4)
    (6, 1, 0.125, 0.0703)
    """
    first, second = checked_outcomes("first_correct", first_correct), checked_outcomes("second_correct", second_correct)
    if first.shape != second.shape:
        raise ValueError(f"need the same episodes for both, got {len(first)} and {len(second)}")
    first_only, second_only = int(np.sum(first & ~second)), int(np.sum(second & ~first))
    fewer, discordant = min(first_only, second_only), first_only + second_only
    if discordant == 0:
        return McNemar(len(first), 0, 0, 1.0, 1.0)
    at_most = _at_most(fewer, discordant)
    below = _at_most(fewer - 1, discordant) if fewer else 0.0
    if first_only == second_only:
        return McNemar(len(first), first_only, second_only, 1.0, 1.0 - (at_most - below) / 2)
    return McNemar(len(first), first_only, second_only, min(2 * at_most, 1.0), at_most + below)


def _at_most(heads: int, tosses: int) -> float:
    """Probability of at most so many heads, fewer than the tosses; more exact than ``scipy.special.bdtr``."""
    return float(betainc(tosses - heads, heads + 1, 0.5))
