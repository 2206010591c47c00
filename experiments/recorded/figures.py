"""Figures of ``recorded``."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from experiments.recorded.fold import LAWS
from experiments.recorded.identifying import FIXED, GAIN, PLAN, RANDOM
from experiments.recorded.results import STATED, Part
from experiments.reporting.style import INK, PALETTE, Picture

_COLOURS = {RANDOM: PALETTE[4], FIXED: PALETTE[2], GAIN: PALETTE[0], PLAN: PALETTE[3]}
_OF_LAW = dict(zip(LAWS, (PALETTE[1], PALETTE[4], PALETTE[3], PALETTE[0]), strict=True))
_OF_LAW_NAMES = {"none": "no correlation", "repeats": "one ρ", "flat": "one ρ for all pairs", "kernel": "kernel"}


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
            "Stops that state a probability, and the share of them that is right; below the line claims are too "
            "strong. The size of a point grows with the number of stops.",
            [lambda axes: _stopping(axes, part, threshold)],
            {_OF_LAW_NAMES[law]: _OF_LAW[law] for law in LAWS},
            (4.0, 3.4),
        ),
    ]
    if len(part.folds[0].bank.action_names) > 1:
        found.append(
            Picture(
                "kernel",
                "Correlation of the errors of two touches of one object, by their actions, as fitted.",
                [lambda axes: _kernel(axes, part)],
                {},
                (4.4, 3.8),
            )
        )
    return found


def _progress(axes: Axes, part: Part) -> None:
    most = max(len(one.result.poses) for one in part.named)
    for decider, colour in _COLOURS.items():
        chosen = [one.result for one in part.named if (one.decider, one.law) == (decider, "kernel")]
        if not chosen:
            continue
        steps = np.arange(most + 1)
        certain = [np.mean([one.is_certain and len(one.poses) <= step for one in chosen]) for step in steps]
        right = [
            np.mean([one.is_certain and one.is_right and len(one.poses) <= step for one in chosen]) for step in steps
        ]
        axes.step(steps, certain, where="post", color=colour, linewidth=2)
        axes.step(steps, right, where="post", color=colour, linewidth=1.2, linestyle=":")
    axes.set(xlabel="touches", ylabel="share of objects named", ylim=(0, 1.02), xlim=(0, most))


def _stopping(axes: Axes, part: Part, threshold: float) -> None:
    low = min(threshold - 0.1, 0.8)
    axes.plot([low, 1], [low, 1], color=INK, linewidth=0.8)
    edges = np.append(np.unique([threshold, *(edge for edge in STATED if edge > threshold)]), np.inf)
    for law in LAWS:
        chosen = [one.result for one in part.named if one.law == law and one.result.is_certain]
        stated, right = (np.array([getattr(one, name) for one in chosen]) for name in ("stated", "is_right"))
        for first, last in pairwise(edges.tolist()):
            inside = (stated >= first) & (stated < last)
            if inside.sum() >= 10:
                size = 160 * inside.mean() + 12
                axes.scatter(stated[inside].mean(), right[inside].mean(), s=size, color=_OF_LAW[law], alpha=0.8)
    axes.set(xlabel="stated", ylabel="right", xlim=(low, 1.005))


def _kernel(axes: Axes, part: Part) -> None:
    kernel = np.mean([fold.models["kernel"].kernel for fold in part.folds], axis=0)
    names = part.folds[0].bank.action_names
    off = ~np.eye(len(kernel), dtype=bool)
    shown = np.where(off, kernel, np.nan)
    image = axes.imshow(shown, cmap="viridis", vmin=0.0, vmax=max(float(kernel[off].max()), 0.05))
    axes.set_xticks(range(len(names)), names, rotation=60, ha="right")
    axes.set_yticks(range(len(names)), names)
    axes.spines[["left", "bottom"]].set_visible(False)
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.85)
    bar.set_label("correlation")
