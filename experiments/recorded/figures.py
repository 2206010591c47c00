"""Figures of ``recorded``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from belief.validation import Floats
from experiments.recorded.identifying import FIXED, GAIN, RANDOM, Named
from experiments.recorded.results import Measured
from experiments.reporting.style import PALETTE, Picture

_COLOURS = {RANDOM: PALETTE[4], FIXED: PALETTE[2], GAIN: PALETTE[0]}
_MOST_NUMBERS = 12  # actions, for numbers in the picture of a kernel


def pictures(measured: Measured) -> list[Picture]:
    """The figures of a report: progress of identifications, and the kernel."""
    found = [
        Picture(
            "progress",
            f"Share of objects named with probability {measured.threshold:g}, by touches; dotted: rightly named.",
            [lambda axes: _progress(axes, measured)],
            _COLOURS,
            (4.6, 3.4),
        )
    ]
    if (size := len(measured.folds[0].bank.action_names)) > 1:
        found.append(
            Picture(
                "kernel",
                "Correlation of the errors of two touches of one object, by their actions, as fitted; on the diagonal "
                "that of repeats, which is assumed where no action was repeated.",
                [lambda axes: _kernel(axes, measured)],
                {},
                (4.6, min(1.4 + 0.3 * size, 4.2)),
            )
        )
    return found


def _progress(axes: Axes, measured: Measured) -> None:
    most = max(len(one.result.poses) for one in measured.named)
    steps = np.arange(most + 1)
    for decider, colour in _COLOURS.items():
        chosen = measured.named_by(decider)
        certain = [one for one in chosen if one.result.is_certain]
        axes.step(steps, _shares(certain, chosen, steps), where="post", color=colour, linewidth=2)
        right = [one for one in certain if one.result.is_right]
        axes.step(steps, _shares(right, chosen, steps), where="post", color=colour, linewidth=1.2, linestyle=":")
    axes.set(xlabel="touches", ylabel="share of objects named", ylim=(0, 1.02), xlim=(0, most))


def _shares(chosen: Sequence[Named], every: Sequence[Named], steps: np.ndarray) -> Floats:
    """Share of identifications that are chosen and took at most so many touches; every object counts equally."""
    of_object = Counter(one.object_index for one in every)
    weights = [1.0 / of_object[one.object_index] / len(of_object) for one in chosen]
    return np.bincount([len(one.result.poses) for one in chosen], weights, len(steps)).cumsum()


def _kernel(axes: Axes, measured: Measured) -> None:
    kernel = np.mean([fold.models["kernel"].kernel for fold in measured.folds], axis=0)
    names = measured.folds[0].bank.action_names
    largest = max(float(kernel.max()), 0.1)
    image = axes.imshow(kernel, cmap="viridis", vmin=0.0, vmax=largest)
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(length=0)
    axes.spines[["left", "bottom"]].set_visible(False)
    if len(names) <= _MOST_NUMBERS:
        for (row, column), value in np.ndenumerate(kernel):
            colour = "black" if value > 0.6 * largest else "white"
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=7.5, color=colour)
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.85)
    bar.set_label("correlation")
