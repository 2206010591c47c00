"""A frame of an episode: the scene, the touch image and the belief, side by side."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from activetouch.envs.touch_source import LiveTouches, Press, Touches
from activetouch.errors import UnstablePress
from belief import Belief

_SIZE = 240  # edge of each of the three panels [pixels]
_INK, _PAPER, _BAR, _TARGET = (40, 44, 52), (250, 250, 248), (150, 170, 200), (222, 122, 60)


def draw(touches: Touches, press: Press | None, belief: Belief, target: int) -> NDArray[np.uint8]:
    """The frame, ``(240, 720, 3)`` uint8; panels of what there is not are blank."""
    return np.concatenate([_scene(touches, press), _touch(press), _belief(belief, target)], axis=1)


def _blank() -> NDArray[np.uint8]:
    return np.full((_SIZE, _SIZE, 3), _PAPER, np.uint8)


def _scene(touches: Touches, press: Press | None) -> NDArray[np.uint8]:
    if press is None or not isinstance(touches, LiveTouches):
        return _blank()
    from activetouch.view.picture import press_picture  # loads MuJoCo

    scene, rng = touches.sensor.scene, deepcopy(press.rng)
    while True:
        placement = scene.place(press.thing, press.pose, rng)
        try:
            depth = scene.contact(placement, rng).depth
        except UnstablePress:  # pressed again then, and so now
            continue
        return press_picture(scene.stage, placement, depth, _SIZE, _SIZE, opengl=False)[0]


def _touch(press: Press | None) -> NDArray[np.uint8]:
    if press is None:
        return _blank()
    image = Image.fromarray(press.image).convert("RGB")
    return np.asarray(image.resize((_SIZE, _SIZE), Image.Resampling.NEAREST))


def _belief(belief: Belief, target: int) -> NDArray[np.uint8]:
    """A bar for each shape; the target's stands out."""
    picture = Image.fromarray(_blank())
    pen = ImageDraw.Draw(picture)
    height = _SIZE / len(belief.labels)
    for index, (label, prob) in enumerate(zip(belief.labels, belief.probs, strict=True)):
        top = index * height
        bar = [8, top + 0.55 * height, 8 + round((_SIZE - 16) * float(prob)), top + 0.9 * height]
        pen.rectangle(bar, fill=_TARGET if index == target else _BAR)
        pen.text((8, top + 0.1 * height), f"{label} {prob:.3f}", fill=_INK)
    return np.asarray(picture)
