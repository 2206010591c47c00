"""Figures of the calibration report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from belief.metrics import ReliabilityCurve, StopScore
from experiments.calibration.models import ModelScores
from experiments.reporting.style import INK, PALETTE, Picture

_MIN_STOPS = 20  # smallest number of stops with a point in the figure


def reliability(curves: Mapping[str, ReliabilityCurve]) -> Picture:
    """Accuracy against stated confidence, before and after calibration."""

    def panel(title: str, curve: ReliabilityCurve) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            curve.plot(axes)
            axes.set_title(title)

        return draw

    return Picture(
        "reliability",
        "Accuracy of touches by their confidence. A calibrated model's points lie in the grey bars 95 % of the time "
        "(if touches are independent); the area of a point shows its fraction of the touches.",
        [panel(name, curve) for name, curve in curves.items()],
    )


def claims(models: Sequence[ModelScores], shown: Sequence[str], confidence: float) -> Picture:
    """Stated confidence and accuracy at stopping, by number of touches."""
    drawn = [scores for scores in models if scores.name in shown]
    colours = {scores.name: colour for scores, colour in zip(drawn, PALETTE, strict=False)}

    def kept(scores: ModelScores, kind: str) -> list[StopScore]:
        found = scores.stops[kind].claims
        return [] if found is None else [score for score in found.by_num_touches if score.count >= _MIN_STOPS]

    lows = [score.low for scores in drawn for kind in scores.stops for score in kept(scores, kind)]
    lowest = min([confidence, *lows])

    def panel(kind: str) -> Callable[[Axes], None]:
        def draw(axes: Axes) -> None:
            axes.axhline(confidence, color=INK, linewidth=0.8, linestyle=":")
            for place, scores in enumerate(drawn):
                columns = ("num_touches", "mean_stated", "share_right", "low", "high")
                rows = [[getattr(score, name) for name in columns] for score in kept(scores, kind)]
                x, stated, right, low, high = np.array(rows, float).reshape(-1, len(columns)).T
                x = x + 0.16 * (place - (len(drawn) - 1) / 2)
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
        {scores.name: colours[scores.name] for scores in drawn},
    )
