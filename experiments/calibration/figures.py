"""Figures of the calibration report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from scipy.stats import binom

from belief.metrics import ReliabilityCurve, StopScore
from belief.observation_model.repeat_discount import effective_touches
from experiments.calibration.models import UNDISCOUNTED, ModelScores, Weight
from experiments.calibration.orientation import BINS, QUANTITIES, RankTest
from experiments.calibration.targets import FUSED
from experiments.reporting.style import INK, PALETTE, Picture

_CHANCE: dict[str, Any] = {"color": "#8a97a5", "alpha": 0.3, "linewidth": 0}
_MIN_STOPS = 20  # smallest number of stops with a point in the figure


def model_colours(names: Sequence[str]) -> dict[str, str]:
    """A colour for every model; :data:`UNDISCOUNTED` has the colour of the text."""
    fitted = [name for name in names if name != UNDISCOUNTED]
    colours = {name: PALETTE[index % len(PALETTE)] for index, name in enumerate(reversed(fitted))}
    return {name: INK if name == UNDISCOUNTED else colours[name] for name in names}


def reliability(curves: Mapping[str, ReliabilityCurve]) -> Picture:
    """Accuracy against stated confidence, before and after calibration."""

    def panel(title: str, curve: ReliabilityCurve) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            axes.plot([0, 1], [0, 1], color=INK, linewidth=0.8, linestyle=":")
            x, width = curve.mean_confidence, curve.upper - curve.lower
            axes.bar(x, curve.band_high - curve.band_low, width * 0.8, curve.band_low, **_CHANCE)
            size = 8.0 + 120.0 * curve.count / curve.count.sum()
            axes.scatter(x, curve.accuracy, size, color=PALETTE[0], zorder=3)
            low = max(0.0, float(curve.lower.min()) - 0.05)
            axes.set(title=title, xlabel="confidence", ylabel="accuracy", xlim=(low, 1.02), ylim=(low, 1.02))

        return draw

    return Picture(
        "reliability",
        "Accuracy of touches by their confidence. A calibrated model's points lie in the grey bars 95 % of the time "
        "(if touches are independent); the area of a point shows its fraction of the touches.",
        [panel(name, curve) for name, curve in curves.items()],
    )


def fused_error(models: Sequence[ModelScores], chosen: str) -> Picture:
    """Calibration error by number of touches."""
    return Picture(
        "fused_error",
        "Calibration error (most probable shape, 15 bins) of the posterior by number of touches. Grey: error of the "
        f"chosen model by chance alone; dotted: the target, {FUSED}.",
        _by_number(models, chosen, "calibration error", lambda some: some.ece.value, shows_chance=True),
        model_colours([scores.name for scores in models]),
    )


def fused_nll(models: Sequence[ModelScores], chosen: str) -> Picture:
    """Negative log-likelihood by number of touches."""
    return Picture(
        "fused_nll",
        "Negative log posterior of the true shape by number of touches. Where it rises, further touches mislead.",
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
                style = "--" if scores.name == UNDISCOUNTED else "-"
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
    """Stated confidence and accuracy at stopping, by number of touches."""
    colours = model_colours([scores.name for scores in models])
    some = [scores for scores in models if scores.name in shown]

    def kept(scores: ModelScores, kind: str) -> list[StopScore]:
        found = scores.stops[kind].claims
        return [] if found is None else [score for score in found.by_num_touches if score.count >= _MIN_STOPS]

    lows = [score.low for scores in some for kind in scores.stops for score in kept(scores, kind)]
    lowest = min([confidence, *lows])

    def panel(kind: str) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            axes.axhline(confidence, color=INK, linewidth=0.8, linestyle=":")
            for place, scores in enumerate(some):
                columns = ("num_touches", "mean_stated", "share_right", "low", "high")
                rows = [[getattr(score, name) for name in columns] for score in kept(scores, kind)]
                x, stated, right, low, high = np.array(rows, float).reshape(-1, len(columns)).T
                x = x + 0.16 * (place - (len(some) - 1) / 2)
                colour, reach = colours[scores.name], np.maximum([right - low, high - right], 0.0)
                axes.plot(x, stated, color=colour, marker="_", markersize=8, linewidth=0.8)
                axes.errorbar(x, right, reach, fmt="o", color=colour, markersize=4, elinewidth=1)
            axes.set(title=kind, xlabel="touches at stopping", ylabel="probability", ylim=(lowest - 0.02, 1.01))
            axes.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 5, 10], integer=True))

        return draw

    return Picture(
        "claims",
        f"Searches that stop once a shape has a posterior of {confidence:g}: stated confidence (lines) and accuracy "
        f"(points, 95 % Clopper-Pearson) by number of touches, if at least {_MIN_STOPS} stopped.",
        [panel(kind) for kind in models[0].stops],
        {scores.name: colours[scores.name] for scores in some},
    )


def discount(weights: Mapping[str, Sequence[Weight]], correlation: float) -> Picture:
    """Weight of touches in one pose, by the law and fitted freely."""

    def draw(axes: Axes) -> None:
        largest = max(weight.num_touches for some in weights.values() for weight in some)
        numbers = np.linspace(1, largest, 100)
        axes.plot(numbers, numbers, "--", color=INK, linewidth=1)
        axes.plot(numbers, effective_touches(numbers, correlation), color=PALETTE[0], linewidth=1.6)
        for some, shift, colour in zip(weights.values(), (-0.06, 0.06), PALETTE[1:3], strict=True):
            free, low, high = (np.array([getattr(w, name) for w in some], float) for name in ("free", "low", "high"))
            x = np.array([weight.num_touches for weight in some]) + shift
            axes.errorbar(x, free, [free - low, high - free], fmt="o", color=colour, markersize=4, elinewidth=1)
        axes.set(xlabel="touches in one pose", ylabel="weight, in touches", ylim=(0, None))
        axes.set_xticks(range(1, largest + 1))

    return Picture(
        "discount",
        "Weight of n touches in one pose: the weight of their mean evidence that predicts shapes best (points; 95 % "
        "intervals clustered by object), and the law with one fitted number ρ.",
        [draw],
        {"independent": INK, f"n / (1 + (n - 1) · {correlation:.2f})": PALETTE[0]}
        | {f"best on the {split} split": colour for split, colour in zip(weights, PALETTE[1:3], strict=True)},
    )


def orientation_ranks(tests: Sequence[RankTest], shape: str) -> Picture:
    """Histograms of the ranks of a shape's true orientation and size, by number of touches."""
    colours = dict(zip(QUANTITIES, PALETTE, strict=False))
    some = [test for test in tests if test.shape == shape]

    def panel(test: RankTest) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            low, high = np.array(binom.ppf([0.005, 0.995], test.num_objects, 1.0 / BINS)) * BINS / test.num_objects
            axes.axhspan(low, high, **_CHANCE)
            for name, ranks in test.ranks.items():
                density = np.array(ranks.counts) * BINS / test.num_objects
                axes.stairs(density, np.linspace(0.0, 1.0, BINS + 1), color=colours[name], linewidth=1.4)
            title = f"{test.num_touches} touch{'' if test.num_touches == 1 else 'es'}"
            axes.set(title=title, xlabel="rank of the truth", ylabel="density", xlim=(0, 1), ylim=(0, None))

        return draw

    return Picture(
        "orientation",
        f"Ranks of the true orientation and size of {shape} among draws from the posterior, the shape with the least "
        "uniform ones. Those of a calibrated posterior lie in the grey band in 99 % of the bins.",
        [panel(test) for test in some],
        colours,
    )
