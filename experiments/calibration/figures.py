"""Figures of the calibration report: panels that a page stacks where it is narrow, and that a file has side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from belief.metrics import ReliabilityCurve
from belief.observation_model.repeat_discount import effective_touches
from experiments.calibration.models import INDEPENDENT, ModelScores, Weight
from experiments.calibration.targets import FUSED
from experiments.reporting.style import INK, PALETTE, Picture

_CHANCE: dict[str, Any] = {"color": "#8a97a5", "alpha": 0.3, "linewidth": 0}
_ENOUGH = 20  # stops, for a share of them to be shown


def model_colours(names: Sequence[str]) -> dict[str, str]:
    """A colour for every model; the one that takes touches for independent has that of the text."""
    fitted = [name for name in names if name != INDEPENDENT]
    colours = {name: PALETTE[index % len(PALETTE)] for index, name in enumerate(reversed(fitted))}
    return {name: INK if name == INDEPENDENT else colours[name] for name in names}


def reliability(curves: Mapping[str, ReliabilityCurve]) -> Picture:
    """Confidence against share right, before and after calibration."""

    def panel(title: str, curve: ReliabilityCurve) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            axes.plot([0, 1], [0, 1], color=INK, linewidth=0.8, linestyle=":")
            x, width = curve.mean_confidence, curve.upper - curve.lower
            axes.bar(x, curve.band_high - curve.band_low, width * 0.8, curve.band_low, **_CHANCE)
            size = 8.0 + 120.0 * curve.count / curve.count.sum()
            axes.scatter(x, curve.accuracy, size, color=PALETTE[0], zorder=3)
            low = max(0.0, float(curve.lower.min()) - 0.05)
            axes.set(title=title, xlabel="confidence", ylabel="share right", xlim=(low, 1.02), ylim=(low, 1.02))

        return draw

    return Picture(
        "reliability",
        "Touches that are so sure, and how many of them are right. A calibrated model's points lie in the grey bars "
        "95 % of the time (touches taken for independent); the size of a point is its share of the touches.",
        [panel(name, curve) for name, curve in curves.items()],
    )


def fused_error(models: Sequence[ModelScores], chosen: str) -> Picture:
    """Calibration error by number of touches."""
    return Picture(
        "fused_error",
        "Calibration error (top shape, 15 bins) of the posterior after so many touches. Grey: what chance alone gives "
        f"the chosen model; dotted: the target, {FUSED}.",
        _by_number(models, chosen, "calibration error", lambda some: some.ece.value, shows_chance=True),
        model_colours([scores.name for scores in models]),
    )


def fused_nll(models: Sequence[ModelScores], chosen: str) -> Picture:
    """Negative log-likelihood by number of touches."""
    return Picture(
        "fused_nll",
        "Negative log posterior of the true shape after so many touches. Where it rises, further touches mislead.",
        _by_number(models, chosen, "NLL [nats]", lambda some: some.nll, shows_chance=False),
        model_colours([scores.name for scores in models]),
    )


def _by_number(
    models: Sequence[ModelScores], chosen: str, label: str, value: Callable[[Any], float], *, shows_chance: bool
) -> list[Callable[[Axes], None]]:
    colours = model_colours([scores.name for scores in models])
    largest = max(value(some) for scores in models for fused in scores.fused.values() for some in fused)

    def panel(kind: str) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            for scores in models:
                fused = scores.fused[kind]
                numbers, values = [some.num_touches for some in fused], [value(some) for some in fused]
                style = "--" if scores.name == INDEPENDENT else "-"
                width = 2.4 if scores.name == chosen else 1.2
                axes.plot(numbers, values, style, color=colours[scores.name], linewidth=width, marker="o", markersize=3)
                if shows_chance and scores.name == chosen:
                    axes.fill_between(numbers, [some.ece.null_quantile for some in fused], **_CHANCE)
            if shows_chance:
                axes.axhline(FUSED, color=INK, linewidth=0.8, linestyle=":")
            axes.set(title=kind, xlabel="touches", ylabel=label, ylim=(0, 1.08 * largest))
            axes.set_xticks(numbers)

        return draw

    return [panel(kind) for kind in models[0].fused]


def claims(models: Sequence[ModelScores], shown: Sequence[str], confidence: float) -> Picture:
    """Claim and share right at the stop, by the number of touches made until then."""
    colours = model_colours([scores.name for scores in models])
    some = [scores for scores in models if scores.name in shown]
    found = [
        score
        for scores in some
        for stopped in scores.stops.values()
        if stopped.claims is not None
        for score in stopped.claims.by_num_touches
        if score.count >= _ENOUGH
    ]
    lowest = min([confidence, *(score.low for score in found)])

    def panel(kind: str) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            axes.axhline(confidence, color=INK, linewidth=0.8, linestyle=":")
            for place, scores in enumerate(some):
                stopped = scores.stops[kind].claims
                kept = [] if stopped is None else [s for s in stopped.by_num_touches if s.count >= _ENOUGH]
                x = np.array([score.num_touches for score in kept]) + 0.16 * (place - (len(some) - 1) / 2)
                right, low, high = (
                    np.array([getattr(score, name) for score in kept]) for name in ("share_right", "low", "high")
                )
                colour, reach = colours[scores.name], np.maximum([right - low, high - right], 0.0)
                axes.plot(
                    x, [score.mean_stated for score in kept], color=colour, marker="_", markersize=8, linewidth=0.8
                )
                axes.errorbar(x, right, reach, fmt="o", color=colour, markersize=4, elinewidth=1)
            axes.set(title=kind, xlabel="touches at the stop", ylabel="share", ylim=(lowest - 0.02, 1.01))
            axes.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 5, 10], integer=True))

        return draw

    return Picture(
        "claims",
        f"Searches that stop once a shape has {confidence:g} of the posterior: what they claim (lines), how many are "
        f"right (points, 95 % Clopper-Pearson), by touches made; where at least {_ENOUGH} stopped.",
        [panel(kind) for kind in models[0].stops],
        {scores.name: colours[scores.name] for scores in some},
    )


def discount(weights: Mapping[str, Sequence[Weight]], correlation: float) -> Picture:
    """What touches in one pose are worth."""

    def draw(axes: Axes) -> None:
        largest = max(weight.num_touches for some in weights.values() for weight in some)
        numbers = np.linspace(1, largest, 100)
        axes.plot(numbers, numbers, "--", color=INK, linewidth=1)
        axes.plot(numbers, effective_touches(numbers, correlation), color=PALETTE[0], linewidth=1.6)
        for some, shift, colour in zip(weights.values(), (-0.06, 0.06), PALETTE[1:3], strict=True):
            free, low, high = (np.array([getattr(w, name) for w in some]) for name in ("free", "low", "high"))
            x = np.array([weight.num_touches for weight in some]) + shift
            axes.errorbar(x, free, [free - low, high - free], fmt="o", color=colour, markersize=4, elinewidth=1)
        axes.set(xlabel="touches in one pose", ylabel="worth, in touches", ylim=(0, None))
        axes.set_xticks(range(1, largest + 1))

    return Picture(
        "discount",
        "What n touches in one pose are worth: the weight of their mean evidence that predicts shapes best (points; "
        "the 95 % intervals know that touches of one object go together), and the law with the one fitted number ρ.",
        [draw],
        {"all of them": INK, f"n / (1 + (n - 1) · {correlation:.2f})": PALETTE[0]}
        | {f"best on the {split} split": colour for split, colour in zip(weights, PALETTE[1:3], strict=True)},
    )
