"""Figures of ``limit``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.bayes_error.counterparts import Counterpart
from experiments.reporting.style import figure


def draw_counterparts(path: Path, pairs: Sequence[tuple[str, str, Counterpart]], noise: float) -> None:
    """Draw touches, their counterparts, and the differences in units of the noise of a taxel.

    Args:
        path: of the PNG.
        pairs: shape of the touch, shape of the counterpart, and the counterpart.
        noise: standard deviation, relative to full scale.
    """
    with figure((1.9 * len(pairs) + 1.1, 5.8), path) as drawn:
        grid = drawn.subplots(3, len(pairs), squeeze=False)
        for (shape, other, found), (touch, image, difference) in zip(pairs, grid.T, strict=True):
            brightest = max(float(found.touch.max()), 1e-3)
            for axes, picture in ((touch, found.touch), (image, found.image)):
                axes.imshow(np.clip(picture / brightest, 0, 1), cmap="magma", vmin=0, vmax=1, origin="lower")
            shown = difference.imshow(
                (found.touch - found.image).reshape(*found.touch.shape[:2], -1).mean(axis=2) / noise,
                cmap="RdBu_r",
                vmin=-1,
                vmax=1,
                origin="lower",
            )
            touch.set_title(shape.replace("_", " "))
            distance = f"d = {found.distance:.2f}" if found.distance >= 0.01 else "d < 0.01"
            image.set_title(f"{other.replace('_', ' ')}, {distance}", fontsize=8.0)
        for axes, name in zip(grid[:, 0], ("touch", "counterpart", "difference"), strict=True):
            axes.set_ylabel(name, labelpad=6)
        for axes in grid.flat:
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set(visible=True, color="0.8")
        drawn.colorbar(
            shown, ax=grid.ravel().tolist(), label="noise of a taxel", shrink=0.3, anchor=(0.0, 0.0), pad=0.01
        )
