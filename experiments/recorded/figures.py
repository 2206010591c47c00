"""Figures of ``recorded``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from belief.observation_model.action_kernel import Law
from belief.problem import Floats
from experiments.recorded.identifying import FIXED, GAIN, RANDOM, Named
from experiments.recorded.results import SHOWN, Part, stated_bins
from experiments.reporting.style import INK, PALETTE, Picture

_COLOURS = {RANDOM: PALETTE[4], FIXED: PALETTE[2], GAIN: PALETTE[0]}
_OF_LAW: Mapping[Law, str] = {"none": PALETTE[1], "kernel": PALETTE[0]}
_FEWEST = 10  # stops of a point
_MOST_NUMBERS = 12  # actions, for numbers in the picture of a kernel


def pictures(part: Part, threshold: float) -> list[Picture]:
    """The figures of a report: progress of identifications, calibration at stopping, and the kernel."""
    found = [
        Picture(
            "progress",
            f"Share of objects that were named, at probability {threshold:g}, against touches; dotted: rightly named.",
            [lambda axes: _progress(axes, part)],
            _COLOURS,
            (4.6, 3.4),
        ),
        Picture(
            "stopping",
            "Stops that state a probability, and the share of them that is right, with intervals over objects; below "
            "the line claims are too strong.",
            [lambda axes: _stopping(axes, part, threshold)],
            {"independent touches": _OF_LAW["none"], "with the kernel": _OF_LAW["kernel"]},
            (4.6, 3.4),
        ),
    ]
    if (size := len(part.folds[0].bank.action_names)) > 1:
        found.append(
            Picture(
                "kernel",
                "Correlation of the errors of two touches of one object, by their actions, as fitted; on the diagonal "
                "that of repeats, which is assumed where no action was repeated.",
                [lambda axes: _kernel(axes, part)],
                {},
                (4.6, min(1.4 + 0.3 * size, 4.2)),
            )
        )
    return found


def _progress(axes: Axes, part: Part) -> None:
    most = max(len(one.result.poses) for one in part.named)
    for decider, colour in _COLOURS.items():
        chosen = [one for one in part.named if (one.decider, one.law) == (decider, "kernel")]
        if not chosen:
            continue
        steps = np.arange(most + 1)
        certain = [one for one in chosen if one.result.is_certain]
        axes.step(steps, _shares(certain, chosen, steps), where="post", color=colour, linewidth=2)
        right = [one for one in certain if one.result.is_right]
        axes.step(steps, _shares(right, chosen, steps), where="post", color=colour, linewidth=1.2, linestyle=":")
    axes.set(xlabel="touches", ylabel="share of objects named", ylim=(0, 1.02), xlim=(0, most))


def _shares(some: Sequence[Named], every: Sequence[Named], steps: np.ndarray) -> Floats:
    """Share of the identifications that are some and took at most so many touches; every object counts equally."""
    of_object = Counter(one.thing for one in every)
    weights = [1.0 / of_object[one.thing] / len(of_object) for one in some]
    return np.bincount([len(one.result.poses) for one in some], weights, len(steps)).cumsum()


def _stopping(axes: Axes, part: Part, threshold: float) -> None:
    low = min(threshold - 0.1, 0.8)
    axes.plot([low, 1], [low, 1], color=INK, linewidth=0.8)
    for law in SHOWN:
        for one in stated_bins(part, law, threshold):
            if one.stops >= _FEWEST:
                centre, *ends = one.right
                errors = np.abs(np.array(ends) - centre)[:, None]
                axes.errorbar(one.stated, centre, errors, fmt="o", color=_OF_LAW[law], markersize=6, linewidth=1.5)
    axes.set(xlabel="stated", ylabel="right", xlim=(low, 1.005))
    axes.set_ylim(top=1.01)


def _kernel(axes: Axes, part: Part) -> None:
    kernel = np.mean([fold.models["kernel"].kernel for fold in part.folds], axis=0)
    names = part.folds[0].bank.action_names
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
