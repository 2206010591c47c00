"""Touch images in words, for readers who do not see them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_PRESSED = 0.2  # of the brightest pixel
_ROWS, _COLUMNS = ("bottom", "middle", "top"), ("left", "centre", "right")


def image_in_words(image: NDArray[np.uint8]) -> str:
    """How much of an image is pressed, and where it is brightest.

    Args:
        image: ``(H, W)`` or ``(H, W, 3)`` uint8; row 0 is at the bottom.

    >>> image_in_words(np.eye(4, dtype=np.uint8) * 200)
    '25 % of the image pressed, strongest at the bottom left'
    >>> image_in_words(np.zeros((4, 4), np.uint8))
    'nothing pressed'
    """
    bright = image.astype(float).mean(axis=2) if image.ndim == 3 else image.astype(float)
    bright = np.abs(bright - np.median(bright)) if image.ndim == 3 else bright
    if bright.max() == 0.0:
        return "nothing pressed"
    share = float((bright > _PRESSED * bright.max()).mean())
    row, column = np.unravel_index(int(bright.argmax()), bright.shape)
    place = f"{_ROWS[3 * int(row) // bright.shape[0]]} {_COLUMNS[3 * int(column) // bright.shape[1]]}"
    return f"{100 * share:.0f} % of the image pressed, strongest at the {place.replace('middle centre', 'centre')}"


def belief_in_words(bars: Sequence[tuple[str, float, bool]]) -> str:
    """The two likeliest shapes of a belief.

    >>> belief_in_words([("cube", 0.7, False), ("cone", 0.3, True), ("ball", 0.0, False)])
    'cube 0.70, cone 0.30'
    """
    likeliest = sorted(bars, key=lambda bar: -bar[1])[:2]
    return ", ".join(f"{label} {prob:.2f}" for label, prob, _ in likeliest)
