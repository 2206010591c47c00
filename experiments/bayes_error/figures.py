"""Figures of the ambiguity limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from belief.files import atomic_path
from experiments.bayes_error.counterparts import Twin
from experiments.search.figures import PALETTE

_STYLE = {
    "font.size": 9.0,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "activetouch",
}


def draw_convergence(
    folder: Path, sizes: Sequence[int], curves: Mapping[str, Sequence[float]], classifier: Mapping[str, Any], x: str
) -> None:
    """Write ``convergence.svg`` and ``.png``: accuracy by size of what is known, and the classifier's as a line."""
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axes = figure.subplots()
        for (name, curve), colour in zip(curves.items(), PALETTE, strict=False):
            axes.plot(sizes, curve, color=colour, marker="o", markersize=4, label=name)
        axes.axhline(classifier["value"], color="0.25", linestyle="--", linewidth=1, label="the classifier")
        axes.axhspan(*classifier["interval"], color="0.25", alpha=0.12, linewidth=0)
        axes.set(xscale="log", xlabel=x, ylabel="touches read right")
        axes.set_xticks(sizes, [f"{size:,}".replace(",", " ") for size in sizes])
        axes.minorticks_off()
        axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
        for suffix in ("svg", "png"):
            with atomic_path(folder / f"convergence.{suffix}") as temporary:
                figure.savefig(temporary, dpi=130, metadata={"Date": None} if suffix == "svg" else None)


def draw_twins(path: Path, twins: Sequence[tuple[str, str, Twin]], noise: float) -> None:
    """Write a picture of some twins: the touch, its twin, and their difference in units of the noise of a taxel.

    Args:
        path: of the PNG.
        twins: shape of the touch, shape of the twin, and the twin.
        noise: standard deviation, relative to full scale.
    """
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(1.9 * len(twins) + 1.1, 5.8), layout="constrained")
        grid = figure.subplots(3, len(twins), squeeze=False)
        for (shape, other, twin), (touch, image, difference) in zip(twins, grid.T, strict=True):
            brightest = max(float(twin.touch.max()), 1e-3)
            for axes, picture in ((touch, twin.touch), (image, twin.image)):
                axes.imshow(np.clip(picture / brightest, 0, 1), cmap="magma", vmin=0, vmax=1, origin="lower")
            shown = difference.imshow(
                (twin.touch - twin.image).reshape(*twin.touch.shape[:2], -1).mean(axis=2) / noise,
                cmap="RdBu_r",
                vmin=-1,
                vmax=1,
                origin="lower",
            )
            touch.set_title(shape.replace("_", " "))
            distance = f"d = {twin.distance:.2f}" if twin.distance >= 0.01 else "d < 0.01"
            image.set_title(f"{other.replace('_', ' ')}, {distance}", fontsize=8.0)
        for axes, name in zip(grid[:, 0], ("touch", "twin", "difference"), strict=True):
            axes.set_ylabel(name, labelpad=6)
        for axes in grid.flat:
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set(visible=True, color="0.8")
        figure.colorbar(
            shown, ax=grid.ravel().tolist(), label="noise of a taxel", shrink=0.3, anchor=(0.0, 0.0), pad=0.01
        )
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=130)
