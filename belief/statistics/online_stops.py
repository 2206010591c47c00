"""A threshold for answers that learns from outcomes that are reported later, valid at every time.

**The theorem.** Let the reported outcomes be independent and alike, each a stated probability and whether the answer
was wrong. With probability at least ``confidence``, P(wrong | stated ≥ threshold) ≤ ``risk`` for the threshold of
:class:`OnlineStops` *at every time*, however long it is used and whenever one looks.

*Proof.* For each threshold of a fixed list, the wealth of bets 1 + λ (risk - wrong), on the outcomes that it would have
let pass, is a nonnegative supermartingale if more than ``risk`` of these are wrong. A threshold is accepted once its
wealth has reached 1 / (1 - confidence); for a wrong one this ever happens with probability at most 1 - confidence
(Ville 1939). Thresholds are accepted in chains, each from one of three entries downwards, at a third of the level: a
wrong acceptance in a chain needs that of its first wrong threshold, so no more correction is due (fixed-sequence
testing). All accepted thresholds keep the promise, so the lowest is used. It needs ten outcomes of its own, between it
and the next larger threshold, so that none is accepted that only answers above it speak for.

After a change of the world, the accepted threshold may let too many wrong answers pass. Opposite bets, 1 + λ (wrong -
risk), on the answers that it lets pass find that out: when their wealth reaches 20, nothing is accepted any more, and
all begins again with the outcomes that follow, at a level that is divided among all beginnings.

>>> stops = OnlineStops(risk=0.1)
>>> stops.threshold
inf
>>> for _ in range(60):
...     stops = stops.after(0.97, is_wrong=False)
>>> stops.threshold
inf
>>> for _ in range(40):
...     stops = stops.after(0.96, is_wrong=False)
>>> stops.threshold
0.95
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from belief.constraints import Fraction, check
from belief.frozen import FrozenArrays
from belief.table import Table, Tabular
from belief.validation import Floats, require_number

GRID = (0.999, 0.998, 0.995, 0.99, 0.98, 0.97, 0.95, 0.93, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5)
"""Thresholds that can be accepted."""
_GRID = np.array(GRID)
_ENTRIES = (GRID.index(0.99), GRID.index(0.95), GRID.index(0.9))  # where chains begin
FALSE_ALARM = 0.05
"""Probability that a threshold that keeps its promise is ever withdrawn, at each beginning."""
_OWN = 10  # least number of outcomes from a threshold to the next larger one
_SHARES = np.array([0.1, 0.25, 0.5, 0.75, 0.95])  # of the largest bet; one more part of the wealth bets nothing
_BEGIN = np.full(6, 1.0 / 6)
_STEADY = 30  # after t outcomes, a part 1 / (t + 30) of the wealth moves between bets: a late change is found as well


@dataclass(frozen=True, eq=False)
class OnlineStops(FrozenArrays, Tabular):
    """A threshold of stated probabilities, from the outcomes that were reported so far; immutable.

    Attributes:
        risk: largest share of wrong answers among those that the threshold lets pass.
        confidence: probability with which the promise holds at all times.
        wealth: of the bets for each threshold of :data:`GRID`, as logarithms, ``(14, 5)``.
        seen: outcomes from each threshold up to the next larger one, ``(14,)``.
        reached: whether the wealth of each threshold has ever been enough, with outcomes of its own, ``(14,)``.
        alarm: wealth of the bets against the accepted threshold, ``(6,)``.
        watched: answers on which these bet.
        beginnings: how often a threshold was withdrawn.
        num_outcomes: outcomes since the last beginning.
        num_wrong: wrong ones of these.

    Raises:
        InvalidArgument: a number is out of its range.
    """

    risk: Fraction = 0.05
    confidence: Fraction = 0.9
    wealth: Floats | None = None
    seen: NDArray[np.int64] | None = None
    reached: NDArray[np.bool_] | None = None
    alarm: Floats | None = None
    watched: int = 0
    beginnings: int = 0
    num_outcomes: int = 0
    num_wrong: int = 0

    def __post_init__(self) -> None:
        check(self)
        if self.wealth is None:
            object.__setattr__(self, "wealth", np.full((len(GRID), len(_SHARES)), -np.log(len(_SHARES))))
        if self.seen is None:
            object.__setattr__(self, "seen", np.zeros(len(GRID), np.int64))
        if self.reached is None:
            object.__setattr__(self, "reached", np.zeros(len(GRID), np.bool_))
        if self.alarm is None:
            object.__setattr__(self, "alarm", _BEGIN)
        self.freeze()

    @property
    def threshold(self) -> float:
        """Stated probability from which an answer is given; infinite where nothing is promised yet."""
        assert self.reached is not None, "set at construction"
        lowest, reached = math.inf, self.reached.tolist()
        for entry in _ENTRIES:
            for threshold, is_reached in zip(GRID[entry:], reached[entry:], strict=True):
                if not is_reached:
                    break
                lowest = threshold
        return lowest

    @cached_property
    def _level(self) -> float:
        """Log wealth that is enough: the levels of all beginnings and chains have the sum 1 - confidence."""
        shares = len(_ENTRIES) * (self.beginnings + 1) * (self.beginnings + 2)
        return math.log(shares / (1.0 - self.confidence))

    def after(self, stated: float, is_wrong: bool) -> OnlineStops:
        """The threshold after one more outcome. Report all outcomes that become known, whatever they are.

        Args:
            stated: the probability that was stated of the likeliest answer, whether it was given or not, in [0, 1].
            is_wrong: whether this answer was wrong.
        """
        require_number("stated", stated, 0.0, 1.0)
        assert self.wealth is not None, "set at construction"
        assert self.alarm is not None, "set at construction"
        assert self.seen is not None, "set at construction"
        assert self.reached is not None, "set at construction"
        wrong, passes, threshold = float(bool(is_wrong)), stated >= _GRID, self.threshold
        if stated >= threshold:
            bets = np.append(_SHARES / self.risk, 0.0)
            held = self.alarm * (1.0 + bets * (wrong - self.risk))
            total, moving = held.sum(), 1.0 / (self.watched + _STEADY)
            if total >= 1.0 / FALSE_ALARM:
                return OnlineStops(self.risk, self.confidence, beginnings=self.beginnings + 1)
            alarm, watched = (1.0 - moving) * held + moving * total * _BEGIN, self.watched + 1
        else:
            alarm, watched = self.alarm, self.watched
        won = np.log1p(_SHARES / (1.0 - self.risk) * (self.risk - wrong))
        wealth = self.wealth + passes[:, None] * won
        seen = self.seen + (np.arange(len(GRID)) == int(np.argmax(np.append(passes, True))))
        reached = self.reached | ((np.logaddexp.reduce(wealth, axis=1) >= self._level) & (seen >= _OWN))
        counted = {"num_outcomes": self.num_outcomes + 1, "num_wrong": self.num_wrong + bool(is_wrong)}
        found = replace(self, wealth=wealth, seen=seen, reached=reached, alarm=alarm, watched=watched, **counted)
        return found if found.threshold == threshold else replace(found, alarm=_BEGIN, watched=0)

    def table(self) -> Table:
        """The threshold, and from how many outcomes since the last beginning."""
        limit = "never" if self.threshold == math.inf else f"{self.threshold:g}"
        row = (limit, self.num_outcomes, self.num_wrong, self.beginnings)
        note = f"P(wrong | answered) ≤ {self.risk:g} at all times, with confidence {self.confidence:g}."
        return Table("", ["answer from", ("outcomes", "d"), ("wrong", "d"), ("withdrawn", "d")], [row], note)
