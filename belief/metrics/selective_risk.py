"""Selective risk against coverage: how often answers are wrong if only the most trusted ones are given.

Answers are ranked by a score, the most trusted first. At coverage c, only the first c of all cases are answered; the
risk is the fraction of wrong answers among these (El-Yaniv & Wiener 2010). A score is useful if the risk falls with the
coverage. The area under the curve, the mean risk over all coverages, summarises it (Geifman & El-Yaniv 2017).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.frozen import FrozenArrays
from belief.validation import Floats, checked_outcomes, checked_values, require_count, require_fraction


@dataclass(frozen=True, eq=False)
class RiskCoverage(FrozenArrays):
    """Selective risk at each coverage.

    Attributes:
        coverage: fraction of all cases that are answered, ``(m,)``, ascending: 1/n, 2/n … m/n for m answers to n cases.
        risk: expected fraction of wrong answers among these, ``(m,)``; equally trusted answers are in random order.
        area: mean risk over the coverages.
        interval: of the area, by a percentile bootstrap over the answers.
        confidence: of the interval.
    """

    coverage: Floats
    risk: Floats
    area: float
    interval: tuple[float, float]
    confidence: float = 0.95

    def __post_init__(self) -> None:
        self.freeze()

    @property
    def full_risk(self) -> float:
        """Fraction of wrong answers among all answers."""
        return float(self.risk[-1])


def risk_coverage(
    trust: ArrayLike,
    correct: ArrayLike,
    rng: np.random.Generator,
    num_unanswered: int = 0,
    confidence: float = 0.95,
    num_resamples: int = 2000,
) -> RiskCoverage:
    """The curve of selective risk against coverage.

    Args:
        trust: score of each answer, higher for those that are given first, ``(m,)``.
        correct: whether each answer is right, ``(m,)``, booleans or 0 and 1.
        rng: draws the resamples.
        num_unanswered: cases without an answer; they lower the coverage, and not the risk.
        confidence: of the interval, in (0, 1).
        num_resamples: bootstrap resamples.

    Raises:
        ValueError: the lists are empty or differ in length, hold other values, or a number is out of its range.

    The third answer is wrong, and least trusted:

    >>> curve = risk_coverage([0.9, 0.8, 0.5], [True, True, False], np.random.default_rng(0), num_unanswered=1)
    >>> curve.coverage.tolist(), curve.risk.round(2).tolist(), round(curve.area, 2)
    ([0.25, 0.5, 0.75], [0.0, 0.0, 0.33], 0.11)
    """
    scores, right = checked_values("trust", trust), checked_outcomes("correct", correct)
    if scores.shape != right.shape:
        raise ValueError(f"need a score for each of {len(right)} answers, got {scores.shape}")
    if isinstance(num_unanswered, bool) or not isinstance(num_unanswered, int | np.integer) or num_unanswered < 0:
        raise ValueError(f"num_unanswered must be an integer ≥ 0, got {num_unanswered!r}")
    require_fraction("confidence", confidence)
    require_count("num_resamples", num_resamples)
    levels = np.unique(-scores, return_inverse=True)[1]  # 0 for the most trusted
    order = levels.argsort(kind="stable")
    levels, wrong = levels[order], ~right[order]
    number = len(wrong)
    risk = _risk(levels, wrong)
    areas = np.array(
        [
            _risk(levels[drawn], wrong[drawn]).mean()
            for drawn in (np.sort(rng.integers(number, size=number)) for _ in range(num_resamples))
        ]
    )
    low, high = np.quantile(areas, [(1.0 - confidence) / 2, (1.0 + confidence) / 2])
    coverage = np.arange(1, number + 1) / (number + num_unanswered)
    return RiskCoverage(coverage, risk, float(risk.mean()), (float(low), float(high)), confidence)


def _risk(levels: NDArray[np.intp], wrong: NDArray[np.bool_]) -> Floats:
    """Risk among the first 1, 2, … answers; those of one level count as their mean."""
    shares = np.bincount(levels, wrong) / np.maximum(np.bincount(levels), 1)
    return np.asarray(shares[levels].cumsum() / np.arange(1, len(levels) + 1))
