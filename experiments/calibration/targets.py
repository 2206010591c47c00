"""Targets of calibrated probabilities, and the verdict of a calibration report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from belief.metrics import StopScore
from experiments.calibration.models import Fused, ModelScores, StopScores
from experiments.calibration.touches import TouchScores

CLASSWISE = 0.02
"""Limit of the calibration error of one touch, mean over shapes."""
CLASSWISE_UPPER = 0.025
"""Limit of the upper 95 % bound of that error."""
FUSED = 0.02
"""Limit of the calibration error after any number of touches."""
GAP = 0.02
"""Limit of the difference between stated confidence and accuracy at stopping, after any number of touches."""
ENOUGH_STOPS = 200
"""Least number of stops for which the gap after a number of touches is judged."""
ENOUGH_IN_ALL = 2_000
"""Least number of stops for which their accuracy is judged."""


@dataclass(frozen=True)
class Check:
    """One target and its outcome.

    Attributes:
        target: description.
        value: the worst value, as text.
        missed_by: excess over the limit; zero or less if the target is met, None if there is too little data.
        detail: where the worst value is, and the error by chance.
    """

    target: str
    value: str
    missed_by: float | None
    detail: str

    @property
    def holds(self) -> bool:
        """Whether the target was met."""
        return self.missed_by is not None and self.missed_by <= 0.0


def judge_touches(scores: TouchScores) -> Check:
    """Check the classwise error of single touches."""
    error, (_, low, high) = scores.report.ece_classwise, scores.classwise
    return Check(
        f"classwise error of a touch ≤ {CLASSWISE:.3f}, its 95 % bound ≤ {CLASSWISE_UPPER:.3f}",
        f"{error.value:.3f}",
        max(error.value - CLASSWISE, high - CLASSWISE_UPPER),
        f"bias-corrected interval [{low:.3f}, {high:.3f}]; 95 % quantile by chance {error.null_quantile:.3f}",
    )


def judge_model(scores: ModelScores, confidence: float) -> dict[str, list[Check]]:
    """Check a model on every kind of sequence: its fused touches, and its stops at a posterior of ``confidence``."""
    return {
        kind: [
            _judge_fused(scores.fused[kind]),
            _judge_right(scores.stops[kind], confidence),
            _judge_gaps(scores.stops[kind]),
        ]
        for kind in scores.fused
    }


def _judge_fused(fused: Sequence[Fused]) -> Check:
    worst = max(fused, key=lambda score: score.ece.value)
    return Check(
        f"calibration error ≤ {FUSED:.3f} after every number of touches",
        f"{worst.ece.value:.3f}",
        worst.ece.value - FUSED,
        f"after {_touches(worst.num_touches)}; 95 % quantile by chance {worst.ece.null_quantile:.3f}",
    )


def _judge_right(stopped: StopScores, confidence: float) -> Check:
    target = f"accuracy at stopping ≥ {confidence:.3f} (lower Clopper-Pearson bound)"
    if stopped.claims is None or stopped.claims.overall.count < ENOUGH_IN_ALL:
        count = 0 if stopped.claims is None else stopped.claims.overall.count
        return Check(target, "", None, f"{count} stops, {ENOUGH_IN_ALL} are needed")
    assert stopped.right is not None, "there are stops"
    overall, (_, low, high) = stopped.claims.overall, stopped.right
    return Check(
        target,
        f"{overall.low:.3f}",
        confidence - overall.low,
        f"{overall.count} stops: stated confidence {overall.mean_stated:.3f}, accuracy {overall.share_right:.3f}, "
        f"[{low:.3f}, {high:.3f}] if objects are resampled",
    )


def _judge_gaps(stopped: StopScores) -> Check:
    target = f"stated confidence within {GAP:.3f} of accuracy after every number of touches with ≥ {ENOUGH_STOPS} stops"
    judged = [] if stopped.claims is None else [s for s in stopped.claims.by_num_touches if s.count >= ENOUGH_STOPS]
    if not judged:
        return Check(target, "", None, f"no number of touches has {ENOUGH_STOPS} stops")
    worst = max(judged, key=_gap)
    chance = "within" if worst.is_consistent else "outside"
    return Check(
        target,
        f"{_gap(worst):.3f}",
        _gap(worst) - GAP,
        f"after {_touches(worst.num_touches)}, with {worst.count} stops: stated confidence {worst.mean_stated:.3f}, "
        f"accuracy {worst.share_right:.3f}; the confidence is {chance} [{worst.low:.3f}, {worst.high:.3f}]",
    )


def _gap(score: StopScore) -> float:
    return abs(score.mean_stated - score.share_right)


def verdict(touches: Check, fused: Mapping[str, Sequence[Check]], calibration: str, model: str) -> str:
    """A description of the targets that the chosen calibration and the chosen model meet and miss.

    Args:
        touches: check of single touches under the chosen calibration.
        fused: checks of the chosen model by kind of sequence, see :func:`judge_model`.
        calibration: name of the chosen calibration.
        model: name of the chosen observation model.
    """
    outcome = "meets its target" if touches.holds else f"misses its target by {touches.missed_by or 0.0:.3f}"
    checks = [(kind, check) for kind, of_kind in fused.items() for check in of_kind]
    judged = [(kind, check) for kind, check in checks if check.missed_by is not None]
    met = sum(check.holds for _, check in judged)
    unknown = f" ({len(checks) - len(judged)} more could not be judged)" if len(judged) < len(checks) else ""
    sentences = [
        f"A single touch, calibrated by {calibration}, {outcome}: its mean calibration error over shapes is "
        f"{touches.value}; {touches.detail}.",
        f"Fused by {model}, the cross-validated choice, touches meet {met} of {len(judged)} targets{unknown}.",
    ]
    sentences += [
        f"Missed by {check.missed_by or 0.0:.3f} on {kind}: {check.target}; it is {check.value}, {check.detail}."
        for kind, check in judged
        if not check.holds
    ]
    return " ".join(sentences)


def _touches(number: int | None) -> str:
    return f"{number} touch{'' if number == 1 else 'es'}"
