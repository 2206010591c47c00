"""Scenes can be seen."""

import numpy as np
import pytest

from activetouch import SHAPES
from activetouch.poses import Placement, turn
from activetouch.pressing.contact import Pad
from activetouch.view import press_picture

pytestmark = pytest.mark.mujoco
ORANGE, DARK = (0.9, 0.45, 0.1), (0.15, 0.16, 0.2)


def share_of(image, colour):
    """Share of pixels that have a colour's hue, however bright."""
    pixels = image.reshape(-1, 3) / 255.0
    brightness = pixels.max(axis=1, keepdims=True)
    hue = pixels / np.maximum(brightness, 1e-9)
    return (np.abs(hue - np.array(colour) / max(colour)).max(axis=1) < 0.06).mean()


def test_object_and_pad_are_seen():
    image = press_picture(Pad(), Placement(SHAPES["cone"], 1.0, turn("y", 1.0)), 0.002, size=(160, 120))
    assert image.shape == (120, 160, 3)
    assert image.dtype == np.uint8
    assert 0.03 < share_of(image, ORANGE) < 0.5
    assert 0.03 < share_of(image, DARK) < 0.5
