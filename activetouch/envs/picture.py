"""A frame of an episode: the scene, the touch image and the belief, side by side."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from activetouch.envs.touch_source import RecordedPress
from belief import Belief

_SIZE = 240  # edge of each of the three panels [pixels]
_INK, _PAPER, _BAR, _TARGET = (40, 44, 52), (250, 250, 248), (150, 170, 200), (222, 122, 60)


def draw(press: RecordedPress | None, belief: Belief, target: int) -> NDArray[np.uint8]:
    """The frame of an episode, ``(240, 720, 3)`` uint8.

    Args:
        press: the last press; None leaves the panels of scene and image blank.
        belief: about the current object.
        target: index of the target shape.
    """
    return np.concatenate([_scene(press), _touch(press), _belief(belief, target)], axis=1)


def _blank() -> NDArray[np.uint8]:
    return np.full((_SIZE, _SIZE, 3), _PAPER, np.uint8)


def _scene(press: RecordedPress | None) -> NDArray[np.uint8]:
    if press is None:
        return _blank()
    from activetouch.view.picture import press_picture  # loads MuJoCo

    again = press.scene.press(press.thing, press.pose, deepcopy(press.rng))
    return press_picture(press.scene.setup, again.placement, again.contact.depth, _SIZE, _SIZE, opengl=False)[0]


def _touch(press: RecordedPress | None) -> NDArray[np.uint8]:
    if press is None:
        return _blank()
    image = Image.fromarray(press.image).convert("RGB")
    return np.asarray(image.resize((_SIZE, _SIZE), Image.Resampling.NEAREST))


def _belief(belief: Belief, target: int) -> NDArray[np.uint8]:
    """A bar for each shape, the target's in another colour."""
    picture = Image.fromarray(_blank())
    pen = ImageDraw.Draw(picture)
    height = _SIZE / len(belief.labels)
    for index, (label, prob) in enumerate(zip(belief.labels, belief.probs, strict=True)):
        top = index * height
        bar = [8, top + 0.55 * height, 8 + round((_SIZE - 16) * float(prob)), top + 0.9 * height]
        pen.rectangle(bar, fill=_TARGET if index == target else _BAR)
        pen.text((8, top + 0.1 * height), f"{label} {prob:.3f}", fill=_INK)
    return np.asarray(picture)
