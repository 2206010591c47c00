"""Scenes can be seen, with OpenGL and without."""

import numpy as np
import pytest

from activetouch import SCENES, SHAPES
from activetouch.placement import Placement
from activetouch.poses import turn
from activetouch.pressing.rig import Rig
from activetouch.pressing.setup import Setup
from activetouch.view import opengl, picture

pytestmark = pytest.mark.mujoco
ORANGE, DARK = (0.9, 0.45, 0.1), (0.15, 0.16, 0.2)


def share_of(image, colour):
    """Share of pixels that have a colour's hue, however bright."""
    pixels = image.reshape(-1, 3) / 255.0
    brightness = pixels.max(axis=1, keepdims=True)
    hue = pixels / np.maximum(brightness, 1e-9)
    return (np.abs(hue - np.array(colour) / max(colour)).max(axis=1) < 0.06).mean()


@pytest.fixture
def without_opengl(monkeypatch):
    monkeypatch.setattr(picture, "draw_in_child", lambda *view: None)


def test_object_and_pad_are_seen_without_opengl(without_opengl):
    image, by_opengl = picture.press_picture(Setup(), Placement(SHAPES["cone"], 1.0, turn("y", 1.0)), 0.002, 160, 120)
    assert not by_opengl
    assert image.shape == (120, 160, 3)
    assert image.dtype == np.uint8
    assert 0.03 < share_of(image, ORANGE) < 0.5
    assert 0.03 < share_of(image, DARK) < 0.5


def test_the_paper_scene_shows_parked_objects(without_opengl):
    scene = SCENES["paper"].scene
    placement = Placement(SHAPES["sphere"], 1.0, turn("y", 0.0))
    blue = (0.3, 0.5, 0.75)
    assert share_of(picture.press_picture(scene.setup, placement, 0.001, 160, 120)[0], blue) > 0.005
    assert share_of(picture.press_picture(Setup(), placement, 0.001, 160, 120)[0], blue) == 0.0


def test_a_miss_can_be_drawn_too(without_opengl):
    placement = Placement(SHAPES["sphere"], 1.0, turn("y", 0.0), np.array([0.06, 0.0]))
    assert picture.press_picture(Setup(), placement, 0.0, 80, 60)[0].std() > 0.0


def test_opengl_draws_the_same_view_where_it_is_there():
    placement = Placement(SHAPES["cone"], 1.0, turn("y", 1.0))
    image, by_opengl = picture.press_picture(Setup(), placement, 0.002, 160, 120)
    if not by_opengl:
        pytest.skip("no OpenGL backend works here")
    assert image.shape == (120, 160, 3)
    assert 0.03 < share_of(image, ORANGE) < 0.5


def test_where_no_backend_works_nothing_is_drawn_and_nothing_breaks(monkeypatch):
    monkeypatch.setattr(opengl, "_BACKENDS", ("no-such-backend",))
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    rig = Rig(Setup(), SHAPES["cone"], 0.002)
    view = opengl.CameraView((0.0, 0.0, 0.0), 0.1, 0.0, 0.0, 35.0, 16, 16)
    assert opengl.draw_in_child(rig.model, rig.data, view) is None
