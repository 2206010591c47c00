"""Confidence intervals of a proportion."""

from __future__ import annotations

import math

from scipy.special import betainccinv, betaincinv, ndtri

from belief.validation import require_fraction

_MOST_TRIALS = 10**15  # below the largest exact integer of a float


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
    z = float(ndtri(upper)) if upper < 1.0 else -float(ndtri((1.0 - float(confidence)) / 2.0))  # never infinite
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
    low = float(betaincinv(some, wrong + 1, tail)) if some else 0.0
    return low, float(betainccinv(some + 1, wrong, tail)) if wrong else 1.0


def _checked(successes: int, trials: int, confidence: float) -> tuple[int, int]:
    some, every = float(successes), float(trials)  # float16 cannot be compared with the largest number of trials
    if not (some.is_integer() and every.is_integer() and 0 <= some <= every and 1 <= every <= _MOST_TRIALS):
        raise ValueError(
            f"need integers with 0 ≤ successes ≤ trials and 1 ≤ trials ≤ {_MOST_TRIALS:g}, got {successes} of {trials}"
        )
    require_fraction("confidence", confidence)
    return int(successes), int(trials)
