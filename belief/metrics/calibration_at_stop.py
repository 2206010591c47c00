"""Calibration at stopping: stated confidence and accuracy of searches at their end, by number of touches.

Touches of one object have correlated errors, so a model that treats them as independent may be calibrated after one
touch and overconfident after several. An average over all numbers of touches does not show that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.statistics.comparison import clopper_pearson_interval
from belief.table import Table, Tabular
from belief.validation import Floats, as_real, at, checked_outcomes, unmasked


@dataclass(frozen=True)
class StopScore:
    """Stated confidence and accuracy of the episodes that stopped after a number of touches, or of all.

    Attributes:
        num_touches: at the stop; None for all episodes together.
        count: number of episodes, ≥ 1.
        mean_stated: mean stated confidence.
        share_right: fraction of correct answers.
        low, high: Clopper-Pearson bounds of that fraction.
    """

    num_touches: int | None
    count: int
    mean_stated: float
    share_right: float
    low: float
    high: float

    @property
    def is_consistent(self) -> bool:
        """Whether the mean stated confidence lies in the interval [low, high]."""
        return self.low <= self.mean_stated <= self.high

    @property
    def excess(self) -> float:
        """How far the mean stated confidence is above the interval; 0 if it is not."""
        return max(self.mean_stated - self.high, 0.0)


@dataclass(frozen=True)
class CalibrationAtStop(Tabular):
    """Stated confidence and accuracy at the stop, by number of touches; prints as a table.

    Attributes:
        by_num_touches: one score for each number of touches that occurs, in ascending order.
        overall: score of all episodes.
        confidence: confidence level of the intervals.
        never: number of further episodes that reached no stop; they are in no score.

    >>> print(calibration_at_stop([0.9, 0.99, 0.97], [True, True, False], [1, 2, 2]))
    touches  count  stated  right           95 %
    ────────────────────────────────────────────
    1            1   0.900  1.000  0.025 … 1.000
    2            2   0.980  0.500  0.013 … 0.987
    all          3   0.953  0.667  0.094 … 0.992
    """

    by_num_touches: tuple[StopScore, ...]
    overall: StopScore
    confidence: float = 0.95
    never: int = 0

    def table(self) -> Table:
        """Stated confidence and accuracy by number of touches, and over all."""
        spec, level = ".3f", f"{100 * self.confidence:g} %"
        return Table(
            "",
            ["touches", ("count", "d"), ("stated", spec), ("right", spec), (level, spec)],
            [
                (
                    "all" if s.num_touches is None else str(s.num_touches),
                    s.count,
                    s.mean_stated,
                    s.share_right,
                    (s.low, s.high),
                )
                for s in (*self.by_num_touches, self.overall)
            ],
            f"{self.never} more never reach the threshold." if self.never else "",
        )


def calibration_at_stop(
    stated: ArrayLike, correct: ArrayLike, num_touches: ArrayLike, confidence: float = 0.95
) -> CalibrationAtStop:
    """Compare the stated confidence of searches with their accuracy, by number of touches.

    Args:
        stated: stated confidence, the posterior probability of the answer at the stop, ``(n,)``, in [0, 1].
        correct: whether the answer was correct, ``(n,)``, booleans or 0 and 1.
        num_touches: number of touches at the stop, ``(n,)``, integers ≥ 0.
        confidence: confidence level of the intervals, in (0, 1).

    Raises:
        ValueError: the arrays are empty or differ in length; a confidence is outside [0, 1]; ``correct`` is not boolean
            or 0 and 1; ``num_touches`` is not integer or is negative.

    >>> calibration_at_stop([0.9, 0.99, 0.97], [True, True, False], [1, 2, 2]).by_num_touches[1].share_right
    0.5
    """
    confidences, right, touches = (
        np.asarray(as_real(stated, "stated"), np.float64),
        checked_outcomes("correct", correct),
        unmasked(num_touches, "num_touches"),
    )
    if confidences.shape != right.shape or touches.shape != right.shape:
        raise ValueError(
            f"need a stated confidence and a number of touches for each of {len(right)} episodes, "
            f"got {confidences.shape} and {touches.shape}"
        )
    bad = ~((confidences >= 0.0) & (confidences <= 1.0))
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(f"stated must lie in [0, 1], got {confidences[row]}{at((row,))}")
    if not np.issubdtype(touches.dtype, np.integer) or touches.min() < 0:
        raise ValueError(f"num_touches must be integers ≥ 0, got {touches.dtype} from {touches.min()}")
    scores = tuple(
        _score(int(number), confidences[touches == number], right[touches == number], confidence)
        for number in np.unique(touches)
    )
    return CalibrationAtStop(scores, _score(None, confidences, right, confidence), confidence)


def _score(num_touches: int | None, confidences: Floats, right: NDArray[np.bool_], confidence: float) -> StopScore:
    low, high = clopper_pearson_interval(int(right.sum()), len(right), confidence)
    return StopScore(num_touches, len(right), float(confidences.mean()), float(right.mean()), low, high)
