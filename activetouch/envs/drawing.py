"""Pictures of an episode, the last touch beside the belief, and a window of matplotlib that shows them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from belief.bayes import Belief

_SIZE = 240  # edge of each of the two panels [pixels]
_INK, _PAPER, _BAR, _TARGET = (40, 44, 52), (250, 250, 248), (150, 170, 200), (222, 122, 60)


def draw(image: NDArray[np.uint8] | None, belief: Belief, target: int) -> NDArray[np.uint8]:
    """The frame of an episode, ``(240, 480, 3)`` uint8: the image, or a blank panel for None, beside the belief."""
    picture = Image.new("RGB", (2 * _SIZE, _SIZE), _PAPER)
    if image is not None:
        picture.paste(Image.fromarray(image).convert("RGB").resize((_SIZE, _SIZE), Image.Resampling.NEAREST))
    pen, height = ImageDraw.Draw(picture), _SIZE / len(belief.labels)
    for index, (label, prob) in enumerate(zip(belief.labels, belief.probs, strict=True)):
        left, top = _SIZE + 8, index * height
        bar = [left, top + 0.55 * height, left + round((_SIZE - 16) * float(prob)), top + 0.9 * height]
        pen.rectangle(bar, fill=_TARGET if index == target else _BAR)
        pen.text((left, top + 0.1 * height), f"{label} {prob:.3f}", fill=_INK)
    return np.asarray(picture)


class Window:
    """A window of matplotlib that shows one frame after the other; where there is no display, nothing is seen."""

    def __init__(self, title: str) -> None:
        from matplotlib import pyplot  # takes half a second

        self._figure = pyplot.figure(num=title, figsize=(2 * _SIZE / 80, _SIZE / 80), dpi=80, clear=True)
        self._image: Any = None

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Show a frame, ``(H, W, 3)`` uint8, in place of the last one."""
        if self._image is None:
            axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
            axes.set_axis_off()
            self._image = axes.imshow(frame)
        self._image.set_data(frame)
        self._figure.show(warn=False)
        self._figure.canvas.draw()
        self._figure.canvas.flush_events()

    def close(self) -> None:
        """Close the window."""
        from matplotlib import pyplot

        pyplot.close(self._figure)
