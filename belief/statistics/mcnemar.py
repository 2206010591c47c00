"""McNemar's test: do two deciders that met the same episodes succeed equally often?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from belief.statistics.inputs import checked_outcomes


@dataclass(frozen=True)
class McNemar:
    """Outcome of :func:`mcnemar_test`.

    Attributes:
        num_episodes: n, episodes that both met.
        first_only: episodes in which only the first was right.
        second_only: episodes in which only the second was right.
        p_value: exact and two-sided, in [0, 1]; never too small, for claims.
        mid_p_value: less half the probability of what was seen, on either side, in [0, 1]; closer to its nominal
            level, and more powerful, where few episodes are discordant (Fagerland et al. 2013).

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
        """By how much the first succeeds more often, in [-1, 1]."""
        return (self.first_only - self.second_only) / self.num_episodes


def mcnemar_test(first_correct: ArrayLike, second_correct: ArrayLike) -> McNemar:
    """Are two success rates on the same episodes equal? Only episodes in which one alone was right tell.

    If they are, the b + c discordant episodes fall to either side like tosses of a fair coin, so that the p-value is
    that of a binomial test. It is exact for any number; the chi-square approximation is not needed.

    Args:
        first_correct: whether the first decider was right, ``(n,)``, booleans or 0 and 1.
        second_correct: the second, on the same episodes in the same order, ``(n,)``.

    Returns:
        Both discordant counts and p-values; p = 1 where nothing is discordant.

    Raises:
        ValueError: empty, of different lengths, or something other than right and wrong.

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
    from scipy import stats  # which takes a quarter of a second

    p_value = float(stats.binomtest(fewer, discordant).pvalue)
    seen = float(stats.binom.pmf(fewer, discordant, 0.5)) * (1 if first_only == second_only else 2)  # on both sides
    return McNemar(len(first), first_only, second_only, p_value, p_value - seen / 2)
