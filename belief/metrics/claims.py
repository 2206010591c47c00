"""Is a search as often right as it claims when it stops? By number of touches, because averages hide the damage.

Touches of one object err together. A model that multiplies them as if they did not is well calibrated after one touch
and claims ever more than it keeps after several.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.problem import Floats
from belief.statistics.inputs import checked_outcomes
from belief.statistics.proportion import clopper_pearson_interval
from belief.validation import as_real, unmasked


@dataclass(frozen=True)
class StopScore:
    """Claim against right, of the episodes that stopped after one number of touches, or of all.

    Attributes:
        num_touches: at which they stopped; None for all episodes together.
        count: how many they are, ≥ 1.
        mean_claim: mean probability of being right that they claimed.
        share_right: how many of them were right.
        low: Clopper-Pearson bound of that share.
        high: the upper one.

    >>> StopScore(num_touches=2, count=50, mean_claim=0.97, share_right=0.8, low=0.66, high=0.9).is_consistent
    False
    """

    num_touches: int | None
    count: int
    mean_claim: float
    share_right: float
    low: float
    high: float

    @property
    def is_consistent(self) -> bool:
        """Whether the mean claim lies in the interval for the share right."""
        return self.low <= self.mean_claim <= self.high


@dataclass(frozen=True)
class ClaimsAtStop:
    """Claim against right at the stop; prints as a table.

    Attributes:
        by_num_touches: one score for each number of touches that occurred, in rising order.
        overall: of all episodes.

    >>> print(claims_at_stop([0.9, 0.99, 0.97], [True, True, False], [1, 2, 2]))
    touches   count   claim   right   95 % interval
    1             1    .900   1.000   .025-1.000
    2             2    .980    .500   .013-.987
    all           3    .953    .667   .094-.992
    """

    by_num_touches: tuple[StopScore, ...]
    overall: StopScore
    confidence: float = 0.95

    def __str__(self) -> str:
        lines = [f"touches   count   claim   right   {100 * self.confidence:g} % interval"]
        for score in (*self.by_num_touches, self.overall):
            name = "all" if score.num_touches is None else str(score.num_touches)
            claim, right, low, high = map(_short, (score.mean_claim, score.share_right, score.low, score.high))
            lines.append(f"{name:<7} {score.count:>7}   {claim:>5}   {right:>5}   {low}-{high}")
        return "\n".join(lines)


def claims_at_stop(
    claims: ArrayLike, correct: ArrayLike, num_touches: ArrayLike, confidence: float = 0.95
) -> ClaimsAtStop:
    """How probable the answer was held to be when the search stopped, against how often it was right.

    Args:
        claims: the belief in the answer at the stop, ``(n,)``, in [0, 1].
        correct: whether the answer was right, ``(n,)``, booleans or 0 and 1.
        num_touches: after which it stopped, ``(n,)``, integers ≥ 0.
        confidence: of the intervals, in (0, 1).

    Raises:
        ValueError: empty, of different lengths, claims outside [0, 1], something other than right and wrong, numbers of
            touches that are none.

    >>> scores = claims_at_stop([0.9, 0.99, 0.97], [True, True, False], [1, 2, 2])
    >>> [(s.num_touches, s.count, round(s.mean_claim, 2), s.share_right) for s in scores.by_num_touches]
    [(1, 1, 0.9, 1.0), (2, 2, 0.98, 0.5)]
    """
    claimed, right, touches = (
        np.asarray(as_real(claims, "claims"), np.float64),
        checked_outcomes("correct", correct),
        unmasked(num_touches, "num_touches"),
    )
    if claimed.shape != right.shape or touches.shape != right.shape:
        raise ValueError(
            f"need a claim and a number of touches for each of {len(right)} episodes, "
            f"got {claimed.shape} and {touches.shape}"
        )
    bad = ~((claimed >= 0.0) & (claimed <= 1.0))
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(f"claims must lie in [0, 1], got {claimed[row]} in row {row}")
    if not np.issubdtype(touches.dtype, np.integer) or touches.min() < 0:
        raise ValueError(f"num_touches must be integers ≥ 0, got {touches.dtype} from {touches.min()}")
    scores = tuple(
        _score(int(number), claimed[touches == number], right[touches == number], confidence)
        for number in np.unique(touches)
    )
    return ClaimsAtStop(scores, _score(None, claimed, right, confidence), confidence)


def _score(num_touches: int | None, claimed: Floats, right: NDArray[np.bool_], confidence: float) -> StopScore:
    low, high = clopper_pearson_interval(int(right.sum()), len(right), confidence)
    return StopScore(num_touches, len(right), float(claimed.mean()), float(right.mean()), low, high)


def _short(value: float) -> str:
    return f"{value:.3f}".removeprefix("0")
