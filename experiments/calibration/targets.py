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
"""Limit of the difference between stated confidence and accuracy at stopping, by number of touches."""
ENOUGH_STOPS = 200
"""Least number of stops for which the gap after a number of touches is judged."""
ENOUGH_IN_ALL = 2_000
"""Least number of stops for which their accuracy is judged."""


@dataclass(frozen=True)
class Check:
    """One target and its outcome.

    Attributes:
        name: with its limit, for the heading of a table.
        target: description.
        value: the worst value, as text.
        missed_by: excess over the limit; zero or less if the target is met, None if there is too little data.
        detail: where the worst value is, and the error by chance.
    """

    name: str
    target: str
    value: str
    missed_by: float | None
    detail: str

    @property
    def holds(self) -> bool:
        """Whether the target was met."""
        return self.missed_by is not None and self.missed_by <= 0.0

    @property
    def outcome(self) -> str:
        """The value and whether it meets the target, for a table."""
        if self.missed_by is None:
            return f"{self.value} too few stops".strip()
        return f"{self.value} {'✓' if self.holds else f'✗ by {decimals(self.missed_by)}'}"


def judge_touches(scores: TouchScores) -> Check:
    """Single touches under a calibration."""
    error, (_, low, high) = scores.report.ece_classwise, scores.classwise
    return Check(
        f"classwise error ≤ {decimals(CLASSWISE)}",
        f"classwise error of a touch ≤ {decimals(CLASSWISE)}, its 95 % bound ≤ {decimals(CLASSWISE_UPPER)}",
        decimals(error.value),
        max(error.value - CLASSWISE, high - CLASSWISE_UPPER),
        f"bias-corrected interval [{decimals(low)}, {decimals(high)}]; "
        f"95 % quantile by chance {decimals(error.null_quantile)}",
    )


def judge_model(scores: ModelScores, confidence: float) -> dict[str, list[Check]]:
    """A model on every kind of sequence: fused touches, and stops at a posterior of ``confidence``."""
    return {
        kind: [
            _judge_fused(scores.fused[kind]),
            _judge_right(scores.stops[kind], confidence),
            _judge_gaps(scores.stops[kind]),
        ]
        for kind in scores.fused
    }


def _judge_fused(fused: Sequence[Fused]) -> Check:
    worst = max(fused, key=lambda some: some.ece.value)
    return Check(
        f"error ≤ {decimals(FUSED)}",
        f"calibration error ≤ {decimals(FUSED)} after every number of touches",
        decimals(worst.ece.value),
        worst.ece.value - FUSED,
        f"after {_touches(worst.num_touches)}; 95 % quantile by chance {decimals(worst.ece.null_quantile)}",
    )


def _judge_right(stopped: StopScores, confidence: float) -> Check:
    name = f"accuracy ≥ {decimals(confidence)}"
    target = f"accuracy at stopping ≥ {decimals(confidence)} (lower Clopper-Pearson bound)"
    if stopped.claims is None or stopped.claims.overall.count < ENOUGH_IN_ALL:
        count = 0 if stopped.claims is None else stopped.claims.overall.count
        return Check(name, target, "", None, f"{count} stops, {ENOUGH_IN_ALL} are needed")
    assert stopped.right is not None, "there are stops"
    overall, (_, low, high) = stopped.claims.overall, stopped.right
    return Check(
        name,
        target,
        decimals(overall.low),
        confidence - overall.low,
        f"{overall.count} stops: stated confidence {decimals(overall.mean_stated)}, "
        f"accuracy {decimals(overall.share_right)}, "
        f"[{decimals(low)}, {decimals(high)}] if objects are resampled",
    )


def _judge_gaps(stopped: StopScores) -> Check:
    name = f"gap ≤ {decimals(GAP)}"
    target = (
        f"stated confidence within {decimals(GAP)} of accuracy after every number of touches with ≥ {ENOUGH_STOPS} "
        "stops"
    )
    judged = [] if stopped.claims is None else [s for s in stopped.claims.by_num_touches if s.count >= ENOUGH_STOPS]
    if not judged:
        return Check(name, target, "", None, f"no number of touches has {ENOUGH_STOPS} stops")
    worst = max(judged, key=_gap)
    chance = "within" if worst.is_consistent else "outside"
    return Check(
        name,
        target,
        decimals(_gap(worst)),
        _gap(worst) - GAP,
        f"after {_touches(worst.num_touches)}, with {worst.count} stops: stated confidence "
        f"{decimals(worst.mean_stated)}, accuracy "
        f"{decimals(worst.share_right)}; the confidence is {chance} "
        f"[{decimals(worst.low)}, {decimals(worst.high)}]",
    )


def _gap(score: StopScore) -> float:
    return abs(score.mean_stated - score.share_right)


def verdict(touches: Check, fused: Mapping[str, Sequence[Check]], calibration: str, model: str) -> str:
    """The targets that the chosen calibration and the chosen model meet, in words.

    Args:
        touches: check of single touches under the chosen calibration.
        fused: checks of the chosen model by kind of sequence, see :func:`judge_model`.
        calibration: the chosen one's name.
        model: the chosen one's name.
    """
    if touches.holds:
        sentences = [f"A single touch, calibrated by {calibration}, meets its target: "]
    else:
        missed = decimals(touches.missed_by or 0.0)
        sentences = [f"A single touch, calibrated by {calibration}, misses its target by {missed}: "]
    sentences[0] += f"its mean calibration error over shapes is {touches.value}; {touches.detail}."
    checks = [(kind, check) for kind, some in fused.items() for check in some]
    judged = [(kind, check) for kind, check in checks if check.missed_by is not None]
    kept = sum(check.holds for _, check in judged)
    unknown = f" ({len(checks) - len(judged)} more could not be judged)" if len(judged) < len(checks) else ""
    sentences.append(
        f"Fused by {model}, the cross-validated choice, touches meet {kept} of {len(judged)} targets{unknown}."
    )
    sentences += [
        f"Missed by {decimals(check.missed_by or 0.0)} on {kind}: {check.target}; it is {check.value}, {check.detail}."
        for kind, check in judged
        if not check.holds
    ]
    return " ".join(sentences)


def _touches(number: int | None) -> str:
    return f"{number} touch{'' if number == 1 else 'es'}"


def decimals(value: float, digits: int = 3) -> str:
    """A number with a fixed number of decimals.

    >>> decimals(0.0214), decimals(1.0)
    ('0.021', '1.000')
    """
    return f"{value:.{digits}f}"
