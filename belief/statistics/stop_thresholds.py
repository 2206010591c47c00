"""Thresholds at which a search may stop, so that the error at every number of touches is bounded with finite samples.

**The theorem.** Let the N searches be independent and equally distributed, and let each list its *candidate stops* in
order: moments at which the decider would confirm an object, with the number of touches of that object, the stated
probability, and whether the object is wrong. For thresholds τ, a search stops at its first candidate whose probability
is at least τ_k, where k is its number of touches; let R_k(τ) = P(wrong | stopped at k). With probability at least
``confidence`` over the searches, the τ that :func:`certified_thresholds` returns has R_k(τ) ≤ ``risk`` for *every* k
with τ_k < ∞, and no search stops at any other k.

*Proof.* The first half of the searches fixes a sequence of thresholds τ¹, τ², …; given that half, the other one is
still independent. Given which of its searches stop at k, their errors are independent Bernoulli variables with mean
R_k. So the lower binomial tail P(Bin(n_k, risk) ≤ wrong_k) is a valid p-value of "R_k > risk" (Clopper and Pearson
1934), and the largest of them over k is one of "R_k > risk for some k" (intersection-union test, Berger 1982). The
sequence is tested in its order at level 1 - confidence, and the last τ before the first failure is returned
(fixed-sequence testing; Angelopoulos et al., *Learn then Test*, arXiv 2110.01052). It can be a wrong one only if the
first wrong one of the sequence was accepted, which has probability at most 1 - confidence. No correction is needed for
the number of k or of thresholds. Control conditional on the stopping time: Ringel et al., arXiv 2402.00857, who use the
same two stages for stops up to a time. The proof holds for any k of a candidate: if
k is the answer instead of the number of touches, the error of every answer is bounded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.constraints import MOST_COUNT
from belief.table import Table, Tabular
from belief.validation import require_fraction

_SURE = (1 - 1e-6, 1 - 1e-5, 0.9999, 0.9995, 0.999, 0.998, 0.995, 0.99, 0.98, 0.97)
_GRID = (*_SURE, 0.95, 0.93, 0.9, 0.85, 0.8, 0.65, 0.5, 0.0)
_MOST_LEVELS = 1000  # numbers of touches that are told apart
_MARGIN = 0.25  # a proposal must pass its own half at this part of the level, so that most pass the other half


@dataclass(frozen=True, eq=False)
class CandidateStops:
    """Moments at which N searches could confirm an object, M in all, in order of search and of time.

    ``searches`` are indices in [0, N), not decreasing; ``touches`` are those of the object, ``probs`` the stated
    probability that it is the target, and ``is_wrong`` whether it is not; all are ``(M,)``.
    """

    searches: NDArray[np.int64]
    touches: NDArray[np.int64]
    probs: NDArray[np.float64]
    is_wrong: NDArray[np.bool_]
    num_searches: int

    def __post_init__(self) -> None:
        for name, kind in (("searches", np.int64), ("touches", np.int64), ("probs", float), ("is_wrong", bool)):
            given: ArrayLike = getattr(self, name)
            array = np.asarray(given).astype(kind)
            if array.ndim != 1 or len(array) != len(np.atleast_1d(self.searches)) or not (array == given).all():
                raise ValueError(f"{name} must be one {np.dtype(kind)} for each candidate, got {given!r:.80}")
            object.__setattr__(self, name, array)
        if self.num_searches < 0 or not ((self.searches >= 0) & (self.searches < self.num_searches)).all():
            raise ValueError(f"searches must be indices in [0, {self.num_searches})")
        if (np.diff(self.searches) < 0).any():
            raise ValueError("searches must not decrease: candidates stand in order of search and of time")
        if (self.touches < 0).any() or not ((self.probs >= 0.0) & (self.probs <= 1.0)).all():
            raise ValueError("touches must be ≥ 0 and probs in [0, 1]")

    @classmethod
    def of_posteriors(cls, log_probs: NDArray[np.float64], shapes: NDArray[np.int64]) -> CandidateStops:
        """Candidates after each touch: the top shapes of ``log_probs (S, n, K)``, judged by true ``shapes (S,)``."""
        number, length, _ = log_probs.shape
        searches, touches = np.divmod(np.arange(number * length), length)
        stated = np.exp(np.minimum(log_probs.max(axis=2), 0.0))
        is_wrong = log_probs.argmax(axis=2) != shapes[:, None]
        return cls(searches, touches + 1, stated.ravel(), is_wrong.ravel(), number)

    def between(self, first: int, end: int) -> CandidateStops:
        """The candidates of the searches with ``first`` ≤ index < ``end``."""
        low, high = np.searchsorted(self.searches, [first, end])
        rows = slice(low, high)
        searches = self.searches[rows] - first
        return CandidateStops(searches, self.touches[rows], self.probs[rows], self.is_wrong[rows], end - first)

    def of(self, drawn: NDArray[np.int64]) -> CandidateStops:
        """The candidates of the searches ``drawn (B,)``, in their order; a search that is named twice counts twice."""
        first, end = np.searchsorted(self.searches, drawn), np.searchsorted(self.searches, drawn, side="right")
        sizes = end - first
        rows = np.repeat(end - np.cumsum(sizes), sizes) + np.arange(sizes.sum())
        numbers = np.repeat(np.arange(len(drawn)), sizes)
        return CandidateStops(numbers, self.touches[rows], self.probs[rows], self.is_wrong[rows], len(drawn))

    def stops(self, thresholds: ArrayLike) -> NDArray[np.int64]:
        """Indices of the candidates at which searches stop, at most one of each search.

        ``thresholds (L,)`` are by number of touches; the last one is for L - 1 touches and more.
        """
        limits = np.asarray(thresholds, float)
        reached = np.flatnonzero(self.probs >= limits[np.minimum(self.touches, len(limits) - 1)])
        return reached[np.unique(self.searches[reached], return_index=True)[1]]

    def counts(self, thresholds: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers of stops and of wrong ones, by number of touches, ``(L,)`` each, for thresholds of :meth:`stops`."""
        number, rows = len(np.asarray(thresholds)), self.stops(thresholds)
        levels = np.minimum(self.touches[rows], number - 1)
        wrong = np.bincount(levels[self.is_wrong[rows]], minlength=number)
        return np.bincount(levels, minlength=number), wrong


@dataclass(frozen=True)
class CertifiedThresholds(Tabular):
    """Result of :func:`certified_thresholds`, by number of touches; prints as a table.

    ``thresholds`` are stated probabilities from which a search may stop, infinite for never; ``stops`` and ``wrong``
    count stops in the half of the searches that tested them. The first entry is for ``first`` touches; the last one
    pools its number and more, and the promise is for all of these together. With ``answers``, entries are of these
    instead, and none is pooled. Where nothing is promised, ``note`` says why. ``words`` are those of the problem for
    touches and searches.
    """

    thresholds: tuple[float, ...]
    stops: tuple[int, ...]
    wrong: tuple[int, ...]
    risk: float
    confidence: float
    num_searches: int
    first: int = 0
    note: str = ""
    answers: tuple[str, ...] = ()
    words: tuple[str, str] = ("touches", "searches")

    @property
    def promise(self) -> str:
        """What is promised, in words; empty if nothing is."""
        if not np.isfinite(self.thresholds).any():
            return ""
        which = "with every answer" if self.answers else f"after every number of {self.words[0]}"
        return (
            f"{which}, at most {self.risk:g} of the stops are wrong, with confidence {self.confidence:g}, from "
            f"{self.num_searches} {self.words[1]}"
        )

    def table(self) -> Table:
        """Thresholds, and the stops that tested them, by number of touches or by answer."""
        numbers = self.answers or range(self.first, self.first + len(self.stops))
        rows: list[tuple[str | int, ...]] = [
            (
                f"≥ {number}" if number == numbers[-1] and not self.answers else str(number),
                {0.0: "any", math.inf: "never"}.get(least, f"{least:g}"),
                *counts,
            )
            for number, least, *counts in zip(numbers, self.thresholds, self.stops, self.wrong, strict=True)
        ]
        usual = "" if self.answers else "Last row: so many and more, together. "
        usual = usual + "Stops: of the half that tests." if self.promise else "Nothing is promised."
        return Table(
            self.promise.capitalize(),
            ["answer" if self.answers else self.words[0], "stop from", ("stops", "d"), ("wrong", "d")],
            rows,
            self.note or usual,
        )


def certified_thresholds(
    candidates: CandidateStops,
    risk: float,
    confidence: float = 0.9,
    answers: Sequence[str] = (),
    words: tuple[str, str] = ("touches", "searches"),
) -> CertifiedThresholds:
    """Thresholds for which the error at every number of touches is at most ``risk``; the module states the theorem.

    ``candidates`` are of independent, equally distributed searches, in an order that says nothing about them. Numbers
    of touches with too few stops in the first half are pooled at the upper end, and never stopped at elsewhere. With
    names of ``answers``, the ``touches`` of candidates are indices of these, and the error of every answer is bounded.
    The result prints in the ``words`` for touches and searches.

    >>> rng = np.random.default_rng(0)
    >>> probs = rng.uniform(0.6, 1.0, 20000)                    # one candidate for each search, which states the truth
    >>> found = CandidateStops(np.arange(20000), np.ones(20000), probs, rng.random(20000) > probs, 20000)
    >>> certified_thresholds(found, risk=0.05).thresholds
    (inf, 0.93)
    """
    require_fraction("risk", risk)
    require_fraction("confidence", confidence)
    if candidates.num_searches < 2:
        raise ValueError(f"at least two {words[1]} are needed, got {candidates.num_searches}")
    level, half = 1.0 - confidence, candidates.num_searches // 2
    proposing, testing = candidates.between(0, half), candidates.between(half, candidates.num_searches)
    chosen = np.full(len(answers) or _num_levels(proposing, risk, level), math.inf)
    for proposed in _proposals(proposing, risk, level, len(chosen)):
        if _p_values(testing, proposed, risk).max() > level:
            break
        chosen = proposed
    stops, wrong = testing.counts(chosen)
    note, least = "", least_searches(risk, confidence)
    if answers and np.isfinite(chosen).any():
        note = _uncertified(candidates, chosen, answers, least)
    if not np.isfinite(chosen).any():
        needed = f"{least // 2} stops{' with an answer' * bool(answers)}"
        note = _nothing(candidates, half, risk, needed, words[1])
        if candidates.num_searches < least:
            number = f"{candidates.num_searches} {words[1]}"
            note = f"Nothing is promised with {number}: at least {least} are needed, if none is wrong."
    return CertifiedThresholds(
        *(tuple(chosen.tolist()), tuple(stops.tolist()), tuple(wrong.tolist())),
        *(risk, confidence, candidates.num_searches),
        note=note,
        answers=tuple(answers),
        words=words,
    )


def _nothing(candidates: CandidateStops, half: int, risk: float, needed: str, word: str) -> str:
    """Why nothing is promised: what would stop where the promise is nearest, however many touches that takes."""
    nearest = min(_GRID, key=lambda threshold: float(_p_values(candidates, np.full(1, threshold), risk)[0]))
    (stops,), (wrong,) = candidates.counts(np.full(1, nearest))
    if not stops:
        return f"Nothing is promised: of {candidates.num_searches} {word}, none states as much as {min(_GRID):g}."
    halves = [candidates.between(*ends).counts([nearest]) for ends in ((0, half), (half, candidates.num_searches))]
    each = ", the other ".join(f"{stops[0]} ({wrong[0]} wrong)" for stops, wrong in halves)
    few = f". Of these one half has {each}; each half needs {needed} if none is wrong, and more if some are"
    return (
        f"Nothing is promised: of all {candidates.num_searches} {word}, {stops} would stop where {nearest:g} is "
        f"stated, {wrong} of them wrongly{few * bool(wrong <= risk * stops)}."
    )


def _uncertified(candidates: CandidateStops, chosen: NDArray[np.float64], answers: Sequence[str], least: int) -> str:
    """Which answers are never given, and why; empty if all are."""
    closed = np.flatnonzero(~np.isfinite(chosen)).tolist()
    numbers = [len(np.unique(candidates.searches[candidates.touches == k])) for k in closed]
    few = [f"{answers[k]} (too few, {n} of {least})" for k, n in zip(closed, numbers, strict=True) if n < least]
    wrong = [f"{answers[k]} (too many wrong)" for k, n in zip(closed, numbers, strict=True) if n >= least]
    return f"Not certifiable: {', '.join(few + wrong)}." if closed else ""


def least_searches(risk: float, confidence: float) -> int:
    """The least number of searches, all without error, from which :func:`certified_thresholds` certifies a stop."""
    return 2 * math.ceil(min(math.log(_MARGIN * (1.0 - confidence)) / math.log1p(-risk), MOST_COUNT))


def _p_values(candidates: CandidateStops, thresholds: NDArray[np.float64], risk: float) -> NDArray[np.float64]:
    """p-value of "more than ``risk`` are wrong" by number of touches, ``(L,)``; 0 where no search stops by rule."""
    stops, wrong = candidates.counts(thresholds)
    tails = np.where(stops > 0, scipy.special.bdtr(wrong.astype(float), np.maximum(stops, 1), risk), 1.0)
    return np.where(np.isfinite(thresholds), tails, 0.0)


def _num_levels(candidates: CandidateStops, risk: float, level: float) -> int:
    """How many numbers of touches are told apart: the last one, which pools the rest, must have enough stops."""
    touches = np.minimum(candidates.touches[candidates.stops([1.0 - risk])], _MOST_LEVELS - 1)
    at_least = np.cumsum(np.bincount(touches, minlength=1)[::-1])[::-1]
    return max(int(np.count_nonzero(at_least >= least_searches(risk, 1.0 - level))), 1)


def _proposals(candidates: CandidateStops, risk: float, level: float, num_levels: int) -> Iterator[NDArray[np.float64]]:
    """A sequence of thresholds: first a safe one for each number of touches, then lower ones, the clearest first."""
    final, steps = np.full(num_levels, math.inf), list[tuple[float, int, float]]()
    for touches in range(num_levels):
        trial, passed = final.copy(), list[tuple[float, int, float]]()
        for threshold in _GRID:
            trial[touches] = threshold
            p_value = float(_p_values(candidates, trial, risk)[touches])
            if p_value <= _MARGIN * level:
                passed.append((p_value, touches, threshold))
        if passed:
            final[touches] = passed[-1][2]
            steps += passed
    safe = {step[1]: step for step in sorted(steps, reverse=True)}  # the smallest p-value of each
    proposed = np.full(num_levels, math.inf)
    for _, touches, threshold in [*sorted(safe.values()), *sorted(steps)]:
        if threshold < proposed[touches]:
            proposed[touches] = threshold
            yield proposed.copy()
