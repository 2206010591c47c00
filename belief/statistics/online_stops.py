"""A threshold for answers that learns from outcomes that are reported later, valid at every time.

**The theorem.** Let the reported outcomes be independent and alike, each a stated probability and whether the answer
was wrong. With probability at least ``confidence``, P(wrong | stated ≥ threshold) ≤ ``risk`` for the threshold of
:class:`OnlineStops` *at every time*, however long it is used and whenever one looks.

*Proof.* For each threshold of a fixed list, count the outcomes that it would have let pass. It is accepted once, for a
k, at most k of n(k) of them are wrong. The numbers n(k) are the least ones for which this ever happens with probability
at most δ if a share ``risk`` is wrong, and it is rarer if more are: n(0) spends a part of δ, n(1) another one, and so
on; the probabilities are computed exactly. Thresholds are accepted in chains, each from one of three entries downwards,
with a part of 1 - confidence as its δ: a wrong acceptance in a chain needs that of its first wrong threshold, so no
more correction is due (fixed-sequence testing). All accepted thresholds keep the promise, so the lowest is used. It
needs ten outcomes of its own, up to the next larger threshold (of an entry, up to the next larger entry), so that none
is accepted that only answers above it speak for.

After a change of the world, the accepted threshold may let too many wrong answers pass. Opposite bets, 1 + λ (wrong -
risk), on the answers that it lets pass find that out: when their wealth reaches 20, nothing is accepted any more, and
all begins again with the outcomes that follow. 1 - confidence is divided among all beginnings: a third each for the
first two, as one change is what most users see, and a third for all that follow.

>>> stops = OnlineStops(risk=0.1)
>>> stops.threshold
inf
>>> for _ in range(60):
...     stops = stops.after(0.97, is_wrong=False)
>>> stops.threshold
0.95
>>> for _ in range(10):
...     stops = stops.after(0.94, is_wrong=False)
>>> stops.threshold
0.9
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray

from belief.constraints import Fraction, Within, check
from belief.errors import InvalidArgument
from belief.frozen import FrozenArrays
from belief.naming import shown
from belief.table import Table, Tabular
from belief.validation import Floats, require_number

GRID = (0.999, 0.998, 0.995, 0.99, 0.98, 0.97, 0.95, 0.93, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5)
"""Thresholds that can be accepted."""
_GRID = np.array(GRID)
_ENTRIES = (GRID.index(0.99), GRID.index(0.95), GRID.index(0.9))  # where chains begin
_PARTS = (0.25, 0.5, 0.25)  # of each chain in 1 - confidence
_SPENT = (0.19, 0.135, 0.14, 0.29)  # parts of δ for 0 to 3 wrong ones; the rest is for more
_MOST_WRONG = 1024  # with more wrong ones, nothing is accepted before the next beginning
FALSE_ALARM = 0.05
"""Probability that a threshold that keeps its promise is ever withdrawn, at each beginning."""
_OWN = 10  # least number of outcomes from a threshold to the next larger one, or from an entry to the next
_SHARES = np.array([0.1, 0.25, 0.5, 0.75, 0.95])  # of the largest bet; one more part of the wealth bets nothing
_BEGIN = np.full(6, 1.0 / 6)
_STEADY = 30  # after t outcomes, a part 1 / (t + 30) of the wealth moves between bets: a late change is found as well


@dataclass(frozen=True, eq=False)
class OnlineStops(FrozenArrays, Tabular):
    """A threshold of stated probabilities, from the outcomes that were reported so far; immutable.

    Attributes:
        risk: largest share of wrong answers among those that the threshold lets pass.
        confidence: probability with which the promise holds at all times.
        seen: outcomes from each threshold of :data:`GRID` up to the next larger one, ``(14,)``.
        wrong: wrong ones of these, ``(14,)``.
        reached: whether each threshold has ever had enough outcomes for each chain, ``(3, 14)``.
        alarm: wealth of the bets against the accepted threshold, ``(6,)``.
        watched: answers on which these bet.
        beginnings: how often a threshold was withdrawn.
        num_outcomes: outcomes since the last beginning.
        num_wrong: wrong ones of these.

    Raises:
        InvalidArgument: a number is out of its range.
    """

    risk: Annotated[float, Within(1e-6, 1.0, open_high=True)] = 0.05
    confidence: Fraction = 0.9
    seen: NDArray[np.int64] | None = None
    wrong: NDArray[np.int64] | None = None
    reached: NDArray[np.bool_] | None = None
    alarm: Floats | None = None
    watched: int = 0
    beginnings: int = 0
    num_outcomes: int = 0
    num_wrong: int = 0

    def __post_init__(self) -> None:
        check(self)
        for name in ("seen", "wrong"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(len(GRID), np.int64))
        if self.reached is None:
            object.__setattr__(self, "reached", np.zeros((len(_ENTRIES), len(GRID)), np.bool_))
        if self.alarm is None:
            object.__setattr__(self, "alarm", _BEGIN)
        self.freeze()

    @property
    def threshold(self) -> float:
        """Stated probability from which an answer is given; infinite where nothing is promised yet."""
        assert self.reached is not None, "set at construction"
        lowest = math.inf
        for entry, reached in zip(_ENTRIES, self.reached.tolist(), strict=True):
            for threshold, is_reached in zip(GRID[entry:], reached[entry:], strict=True):
                if not is_reached:
                    break
                lowest = min(lowest, threshold)
        return lowest

    def after(self, stated: float, is_wrong: bool) -> OnlineStops:
        """The threshold after one more outcome. Report all outcomes that become known, whatever they are.

        Args:
            stated: the probability that was stated of the likeliest answer, whether it was given or not, in [0, 1].
            is_wrong: whether this answer was wrong.
        """
        require_number("stated", stated, 0.0, 1.0)
        if is_wrong not in (False, True):
            raise InvalidArgument(f"is_wrong must be True or False, got {shown(is_wrong)}")
        assert self.alarm is not None, "set at construction"
        assert self.seen is not None, "set at construction"
        assert self.wrong is not None, "set at construction"
        assert self.reached is not None, "set at construction"
        wrong, threshold = float(bool(is_wrong)), self.threshold
        if stated >= threshold:
            bets = np.append(_SHARES / self.risk, 0.0)
            held = self.alarm * (1.0 + bets * (wrong - self.risk))
            total, moving = held.sum(), 1.0 / (self.watched + _STEADY)
            if total >= 1.0 / FALSE_ALARM:
                return OnlineStops(self.risk, self.confidence, beginnings=self.beginnings + 1)
            alarm, watched = (1.0 - moving) * held + moving * total * _BEGIN, self.watched + 1
        else:
            alarm, watched = self.alarm, self.watched
        added = np.arange(len(GRID)) == int(np.argmax(np.append(stated >= _GRID, True)))
        seen, all_wrong = self.seen + added, self.wrong + added * bool(is_wrong)
        limits = _enough(self.risk, self.confidence, self.beginnings)[:, np.minimum(all_wrong.cumsum(), _MOST_WRONG)]
        own = seen.copy()
        own[list(_ENTRIES)] = np.add.reduceat(seen[: _ENTRIES[-1] + 1], [0, *(entry + 1 for entry in _ENTRIES[:-1])])
        reached = self.reached | ((seen.cumsum() >= limits) & (own >= _OWN))
        found = replace(self, seen=seen, wrong=all_wrong, reached=reached, alarm=alarm, watched=watched)
        found = replace(found, num_outcomes=self.num_outcomes + 1, num_wrong=self.num_wrong + bool(is_wrong))
        return found if found.threshold == threshold else replace(found, alarm=_BEGIN, watched=0)

    def table(self) -> Table:
        """The threshold, and from how many outcomes since the last beginning."""
        limit = "never" if self.threshold == math.inf else f"{self.threshold:g}"
        row = (limit, self.num_outcomes, self.num_wrong, self.beginnings)
        note = f"P(wrong | answered) ≤ {self.risk:g} at all times, with confidence {self.confidence:g}."
        return Table("", ["answer from", ("outcomes", "d"), ("wrong", "d"), ("withdrawn", "d")], [row], note)


@lru_cache(maxsize=64)
def _enough(risk: float, confidence: float, beginnings: int) -> Floats:
    """Outcomes that are enough with 0, 1, 2, … wrong ones, for each chain, ``(3, W + 1)``; infinite for the last."""
    share = 1.0 / 3.0 if beginnings < 2 else 1.0 / (3.0 * beginnings * (beginnings - 1))
    return np.array([_fewest(risk, (1.0 - confidence) * share * part) for part in _PARTS])


@lru_cache(maxsize=64)
def _fewest(risk: float, delta: float) -> Floats:
    """The numbers n(k) of the proof."""
    after = 1.0 - sum(_SPENT)
    probs, fewest, number, left = np.array([1.0]), np.full(_MOST_WRONG + 1, np.inf), 0, 0.0
    for k in range(_MOST_WRONG):  # probs: of k, k + 1, … wrong ones, without having been accepted
        left += delta * (_SPENT[k] if k < len(_SPENT) else after / ((k - len(_SPENT) + 1) * (k - len(_SPENT) + 2)))
        steps = math.ceil(math.log(left / probs[0]) / math.log1p(-risk)) if probs[0] > left else 0
        more, gammaln = np.arange(min(steps, _MOST_WRONG) + 1), scipy.special.gammaln
        ways = gammaln(steps + 1) - gammaln(more + 1) - gammaln(steps - more + 1)
        further = np.exp(ways + more * math.log(risk) + (steps - more) * math.log1p(-risk))
        probs = np.convolve(probs, further)[: _MOST_WRONG + 1]
        number, left, probs = number + steps, left - probs[0], probs[1:]
        fewest[k] = number
    return fewest
