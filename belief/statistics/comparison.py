"""Intervals and comparisons of success rates, costs and returns of deciders."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.naming import shown
from belief.validation import (
    MOST_REPEATED,
    Floats,
    are_finite,
    checked_outcomes,
    checked_values,
    require_count,
    require_fraction,
)

_MOST_TRIALS = 10**15  # below the largest exact integer of a float
_BLOCK = 4_000_000  # draws held in memory at a time
LEVEL, POWER = 0.05, 0.8


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson score interval of a proportion, whose coverage is close to nominal.

    Raises:
        ValueError: numbers that are not integers with 0 ≤ successes ≤ trials and 1 ≤ trials ≤ 1e15, or a confidence
            outside (0, 1).

    >>> [round(x, 3) for x in wilson_interval(53, 100)]
    [0.433, 0.625]
    """
    some, every = _checked(successes, trials, confidence)
    upper, share = 0.5 + 0.5 * float(confidence), some / every
    quantile = scipy.special.ndtri
    z = float(quantile(upper)) if upper < 1.0 else -float(quantile((1.0 - float(confidence)) / 2.0))  # never infinite
    denominator = 2.0 * (every + z**2)
    centre = (2.0 * every * share + z**2) / denominator
    reach = z / denominator * math.sqrt(4.0 * every * share * (1.0 - share) + z**2)
    return 0.0 if some == 0 else centre - reach, 1.0 if some == every else centre + reach


def clopper_pearson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper-Pearson interval of a proportion, whose coverage is at least ``confidence``.

    Raises:
        ValueError: numbers that are not integers with 0 ≤ successes ≤ trials and 1 ≤ trials ≤ 1e15, or a confidence
            outside (0, 1).

    >>> [round(x, 4) for x in clopper_pearson_interval(0, 100)]
    [0.0, 0.0362]
    """
    some, every = _checked(successes, trials, confidence)
    wrong, tail = every - some, (1.0 - float(confidence)) / 2
    low = float(scipy.special.betaincinv(some, wrong + 1, tail)) if some else 0.0
    return low, float(scipy.special.betainccinv(some + 1, wrong, tail)) if wrong else 1.0


def _checked(successes: int, trials: int, confidence: float) -> tuple[int, int]:
    # float16 cannot be compared with the largest number of trials
    some, every = (float(number) if are_finite(number) else math.nan for number in (successes, trials))
    if not (some.is_integer() and every.is_integer() and 0 <= some <= every and 1 <= every <= _MOST_TRIALS):
        raise ValueError(
            f"need integers with 0 ≤ successes ≤ trials and 1 ≤ trials ≤ {_MOST_TRIALS:g}, got {shown(successes)} of "
            f"{shown(trials)}"
        )
    require_fraction("confidence", confidence)
    return int(successes), int(trials)


def paired_bootstrap(
    first: ArrayLike,
    second: ArrayLike,
    rng: np.random.Generator,
    confidence: float = 0.95,
    num_resamples: int = 2000,
) -> tuple[float, float, float]:
    """Mean of ``first - second`` over paired episodes, with a percentile bootstrap interval over the pairs.

    Args:
        first: one number per episode, ``(n,)``.
        second: the same episodes in the same order, ``(n,)``.
        rng: draws the resamples.
        confidence: confidence level of the interval, in (0, 1).
        num_resamples: bootstrap resamples.

    Returns:
        (mean difference, lower bound, upper bound).

    Raises:
        ValueError: empty, of different lengths, not finite or beyond ±1e150.

    >>> [round(x, 2) for x in paired_bootstrap([1, 1, 0, 1], [0, 1, 0, 0], np.random.default_rng(0))]
    [0.5, 0.0, 1.0]
    """
    a, b = checked_values("the paired values of first", first), checked_values("the paired values of second", second)
    if a.ndim != 1 or a.shape != b.shape or a.size == 0:
        raise ValueError(f"need two equally long, non-empty lists of episodes, got {a.shape} and {b.shape}")
    require_fraction("confidence", confidence)
    require_count("num_resamples", num_resamples, most=MOST_REPEATED)
    values = a - b
    blocks = (
        _index_blocks(len(values), rng, num_resamples) if np.ptp(values) else ()
    )  # nothing is drawn of equal values
    return _with_bounds(values, [values[drawn].mean(axis=1) for drawn in blocks], confidence)


def cluster_bootstrap(
    values: ArrayLike,
    clusters: ArrayLike,
    rng: np.random.Generator,
    confidence: float = 0.95,
    num_resamples: int = 2000,
) -> tuple[float, float, float]:
    """Mean of clustered values, with a percentile bootstrap interval that resamples whole clusters.

    Values ``(n,)`` have cluster labels ``(n,)`` of any kind, such as the object of a touch: touches of one object have
    correlated errors. Other arguments, result and errors are those of :func:`paired_bootstrap`.

    >>> [round(x, 2) for x in cluster_bootstrap([1, 1, 0, 0], ["a", "a", "b", "b"], np.random.default_rng(0))]
    [0.5, 0.0, 1.0]
    """
    x, groups = checked_values("the values", values), np.asarray(clusters)
    if x.ndim != 1 or x.shape != groups.shape or x.size == 0:
        raise ValueError(f"need as many clusters as values, at least one of each; got {groups.shape} and {x.shape}")
    require_fraction("confidence", confidence)
    require_count("num_resamples", num_resamples, most=MOST_REPEATED)
    _, index = np.unique(groups, return_inverse=True)
    sums, sizes = np.bincount(index, x), np.bincount(index)
    blocks = _index_blocks(len(sizes), rng, num_resamples)
    return _with_bounds(x, [sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1) for drawn in blocks], confidence)


def _index_blocks(size: int, rng: np.random.Generator, num_resamples: int) -> Iterator[NDArray[np.int64]]:
    """Indices of the resamples, in blocks ``(number of resamples, size)`` that fit in memory."""
    rows = max(1, _BLOCK // size)
    for done in range(0, num_resamples, rows):
        yield rng.integers(size, size=(min(rows, num_resamples - done), size))


def _with_bounds(values: Floats, means: list[Floats], confidence: float) -> tuple[float, float, float]:
    if np.ptp(values) == 0.0:  # the mean of equal values may differ by rounding
        return float(values[0]), float(values[0]), float(values[0])
    tail = (1.0 - confidence) / 2
    low, high = np.quantile(np.concatenate(means), [tail, 1.0 - tail])
    return float(values.mean()), float(low), float(high)


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
    # Probability of at most so many heads of so many tosses; more exact than scipy.special.bdtr.
    at_most = float(scipy.special.betainc(discordant - fewer, fewer + 1, 0.5))
    below = float(scipy.special.betainc(discordant - fewer + 1, fewer, 0.5)) if fewer else 0.0
    if first_only == second_only:
        return McNemar(len(first), first_only, second_only, 1.0, 1.0 - (at_most - below) / 2)
    return McNemar(len(first), first_only, second_only, min(2 * at_most, 1.0), at_most + below)


def episodes_for_success(pairs: McNemar, level: float = LEVEL, power: float = POWER) -> int | None:
    """Total number of paired episodes for which McNemar's test detects the observed difference with a given power.

    For a fraction ψ of discordant episodes and success rates that differ by δ, that is
    n = (z_{α/2} √ψ + z_β √(ψ - δ²))² / δ² (Connor 1987), but at least so many that some outcome is significant; None if
    δ is zero. ``level`` is the two-sided α.
    """
    require_fraction("level", level)
    require_fraction("power", power)
    z_level, z_power = -float(scipy.special.ndtri(level / 2)), float(scipy.special.ndtri(power))
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
