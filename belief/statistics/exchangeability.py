"""An alarm that searches no longer come from the world of calibration searches; false alarms are bounded for all time.

**The theorem.** Let the scores of the calibration searches and of the searches after them be exchangeable within each
group (such as the target that is sought), for example because all are independent searches of one world. Then the
probability that :func:`log_e_values` ever reaches log(1/α) is at most α, whatever the scores are: they may be heavy
tailed, tied, or of a world in which some objects are odd. The probability is over the calibration searches, too.

*Proof.* The p-value of a score is its rank among those of its group that came before it, of calibration and since;
ties are broken at random. Under exchangeability, these p-values are independent and uniform (Vovk, Gammerman and
Shafer, *Algorithmic learning in a random world*, theorem 8.2; by groups: section 4.6). Bets (1 - κ) p^-κ on high
scores and (1 - κ) (1 - p)^-κ on low ones have mean 1, so wealth that is spread over them is a nonnegative martingale
that begins with 1, also if a part of it moves between bets at each step. It ever reaches S/α with probability at most
α/S (Ville 1939). The alarm is for any of S scores (union bound), each of whose martingales is one for its own history.

A rank among the calibration scores alone would give p-values that depend on each other through them, and no theorem for
a sequence of searches.

>>> rng = np.random.default_rng(0)
>>> usual, changed = rng.normal(size=(500, 1)), rng.normal(2.0, size=(20, 1))
>>> np.exp(log_e_values(usual, np.zeros(500), changed, np.zeros(20))[[0, 4, 19]]).round().tolist()
[17.0, 1621.0, 939119673666.0]
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from belief.seeding import keyed_rng
from belief.validation import Floats

_POWERS = np.array([0.4, 0.8, 0.5, 0.0])
"""κ of the bets: on high scores, on very high ones, on low ones, and none."""
_IS_LOW = np.array([False, False, True, False])
_BEGIN = np.array([0.35, 0.4, 0.15, 0.1])  # part of the wealth that begins with each, and of what moves
_STEADY = 30  # steps; after t of them, a part 1 / (t + 30) of the wealth moves, so that a late change is found as well
_TIES = 0x71E5
_LEAST = 1e-300  # probability of a low score


def log_e_values(
    calibration: ArrayLike, calibration_groups: ArrayLike, scores: ArrayLike, groups: ArrayLike, seed: int = 0
) -> Floats:
    """Log e-value after each search, ``(T,)``, against exchangeability with the calibration searches (see the module).

    ``calibration (m, S)`` and ``scores (T, S)``, in their order, are finite or infinite; their groups are ``(m,)`` and
    ``(T,)``. A value of log(1/α) or more, at any time, is an alarm.

    >>> log_e_values(np.zeros((5, 2)), np.arange(5), np.empty((0, 2)), []).tolist()
    []
    """
    known, found = np.asarray(calibration, np.float64), np.asarray(scores, np.float64)
    sizes = len(np.atleast_1d(calibration_groups)), len(np.atleast_1d(groups))
    if known.ndim != 2 or found.ndim != 2 or known.shape[1:] != found.shape[1:] or not known.shape[1]:
        raise ValueError(f"scores must be (m, S) and (T, S), got {known.shape} and {found.shape}")
    if sizes != (len(known), len(found)):
        raise ValueError(f"there must be a group for each search, {(len(known), len(found))}, got {sizes}")
    if np.isnan(known).any() or np.isnan(found).any():
        raise ValueError("scores must not be NaN")
    before, since = np.asarray(calibration_groups).tolist(), np.asarray(groups).tolist()
    chance = keyed_rng([seed, _TIES]).random(found.shape)
    wealth = [
        _log_wealth(_p_values(known[:, kind].tolist(), before, found[:, kind].tolist(), since, chance[:, kind]))
        for kind in range(known.shape[1])
    ]
    return np.max(wealth, axis=0) - np.log(len(wealth))


def _p_values(
    known: list[float], before: list[object], scores: list[float], groups: list[object], chance: Floats
) -> Iterable[float]:
    """P-value of each score among those of its group that came before it, in (0, 1]."""
    ranked: dict[object, list[float]] = {group: [] for group in groups}
    for score, group in zip(known, before, strict=True):
        if group in ranked:
            ranked[group].append(score)
    for some in ranked.values():
        some.sort()
    for score, group, tied in zip(scores, groups, chance.tolist(), strict=True):
        others = ranked[group]
        first, after = bisect_left(others, score), bisect_right(others, score)
        yield (len(others) - after + (1.0 - tied) * (after - first + 1)) / (len(others) + 1)
        insort(others, score)


def _log_wealth(p_values: Iterable[float]) -> Floats:
    """Log of the wealth of all bets together after each p-value."""
    high = np.array(list(p_values))[:, None]
    won = (1.0 - _POWERS) * np.where(_IS_LOW, np.maximum(1.0 - high, _LEAST), high) ** -_POWERS
    held, totals = _BEGIN, np.empty(len(won))
    for step, factors in enumerate(won):
        held = held * factors
        totals[step] = held.sum()
        moving = 1.0 / (step + _STEADY)
        held = (1.0 - moving) / totals[step] * held + moving * _BEGIN
    return np.cumsum(np.log(totals))
