"""Extremes of presses, pads, shapes, images and sensor faults."""

import math
from dataclasses import replace

import numpy as np
import pytest

from activetouch import Dynamic, Quasistatic, Scene
from activetouch.errors import UnstablePress
from activetouch.poses import Placement
from activetouch.pressing.contact import Pad
from activetouch.pressing.dynamic import GuardedMove
from activetouch.rendering import (
    DeadTaxels,
    ForcePatchRenderer,
    GelSightRenderer,
    Hysteresis,
    Noise,
    PressureRenderer,
    Quantisation,
    read_out,
)
from activetouch.shapes import EXTENDED_SHAPES, SHAPES, Box, Sphere

pytestmark = pytest.mark.mujoco
PRESSES = {"quasistatic": Quasistatic(), "dynamic": Dynamic(), "guarded_move": GuardedMove()}
BESIDE = (0.2, 0.0)
EXTREMES = {
    "an object beside the pad": {"offset": BESIDE},
    "an object that glances off the rim": {"offset": (0.0149 + 0.019, 0.0)},
    "an object over the corner": {"offset": (0.015, 0.015)},
    "an object of 1 mm": {"shape": Sphere(0.0005)},
    "an object of 50 mm": {"shape": Sphere(0.025), "scale": 2.0},
    "a sharp edge": {"shape": Box((0.016, 0.0001, 0.016))},
    "a frictionless object": {"friction": 0.0},
    "a pad of one taxel": {"pad": Pad(num_taxels=1)},
    "a pad of 1 mm": {"pad": Pad(num_taxels=8, half_width=0.0005)},
    "a target force of 1 mN": {"force": 1e-3},
}


def press_once(press, shape=SHAPES["sphere"], force=2.0, offset=(0.0, 0.0), pad=None, scale=1.0, friction=1.0):
    """Press one object upright."""
    placement = Placement(shape, scale, (1.0, 0.0, 0.0, 0.0), np.array(offset), friction)
    return press.press(pad or Pad(num_taxels=32), placement, force)


def assert_sound(contact):
    """Forces, depths and pressures are finite, not negative, and add up."""
    assert np.isfinite(contact.pressure).all()
    assert np.isfinite([contact.force, contact.depth]).all()
    assert contact.pressure.min() >= 0.0
    assert contact.depth <= contact.pad.max_depth
    pressed = float(contact.pressure.sum() * contact.pad.taxel_area)
    assert contact.is_bottomed_out or math.isclose(pressed, contact.force, rel_tol=1e-6, abs_tol=1e-9)


@pytest.mark.parametrize("press", PRESSES.values(), ids=PRESSES)
@pytest.mark.parametrize("what", EXTREMES)
def test_an_extreme_press_gives_finite_pressures_that_add_up_to_the_force(what, press):
    contact = press_once(press, **EXTREMES[what])
    assert_sound(contact)
    if EXTREMES[what].get("offset") == BESIDE:
        assert contact.force == 0.0
        assert not contact.pressure.any()


@pytest.mark.parametrize("timestep", [5e-4, 5e-3])
def test_a_guarded_move_is_sound_at_any_timestep(timestep):
    assert_sound(press_once(GuardedMove(timestep=timestep, speed=0.02)))


def test_a_vast_force_bottoms_out_or_is_refused_and_no_force_is_no_touch():
    assert press_once(Quasistatic(), force=1e6).is_bottomed_out
    assert_sound(press_once(Quasistatic(), force=1e6))
    assert not press_once(Quasistatic(), force=0.0).pressure.any()
    with pytest.raises(UnstablePress, match=r"did not settle|MuJoCo warnings|N in the pause"):
        press_once(Dynamic(), force=1e6)
    with pytest.raises(UnstablePress, match="Try a smaller timestep"):
        press_once(Dynamic(tolerance=0.0))
    for press in PRESSES.values():
        for force in (math.nan, -1.0):
            with pytest.raises(ValueError, match="force"):
                press_once(press, force=force)


@pytest.mark.parametrize("name", EXTENDED_SHAPES)
def test_every_shape_is_felt_in_any_orientation(name, rng):
    scene = Scene(shapes={"it": EXTENDED_SHAPES[name]}, press_model=Quasistatic(), pad=Pad(num_taxels=32))
    for _ in range(20):
        contact = scene.press(scene.sample_object(0, rng), 0, rng)[0]
        assert contact.force > 0.0
        assert_sound(contact)


@pytest.mark.parametrize("renderer", [PressureRenderer(), GelSightRenderer()], ids=["pressure", "gelsight"])
@pytest.mark.parametrize("how", [{"offset": BESIDE}, {"force": 1e6}, {"pad": Pad(num_taxels=2)}])
def test_an_extreme_contact_has_an_image(renderer, how):
    image = renderer(press_once(Quasistatic(), **how))
    assert ((image >= 0.0) & (image <= 1.0)).all()


def test_images_of_a_moving_miss_and_of_one_taxel():
    image = ForcePatchRenderer()(press_once(GuardedMove(), offset=BESIDE))
    assert ((image >= 0.0) & (image <= 1.0)).all()
    with pytest.raises(ValueError, match="at least 2 × 2"):
        GelSightRenderer()(press_once(Quasistatic(), pad=Pad(num_taxels=1)))


@pytest.mark.parametrize(
    ("level", "faults", "read"),
    [
        (1e308, (), 255),
        (0.5, (DeadTaxels(1.0),), 0),
        (0.6, (Quantisation(1),), 255),
        (0.5, (Hysteresis(2.0),), 0),
    ],
)
def test_extreme_images_and_faults_are_read_out_in_eight_bits(level, faults, read, rng):
    assert (read_out(np.full((4, 4), level), faults, rng) == read).all()
    assert read_out(np.full((4, 4), level), (Noise(1e3),), rng).dtype == np.uint8
    with pytest.raises(ValueError, match="NaN"):
        read_out(np.full((4, 4), math.nan), (), rng)


def test_what_a_scene_cannot_press_is_refused(rng):
    scene = Scene(press_model=Quasistatic())
    thing = scene.sample_object(0, rng)
    for call, words in (
        (lambda: Scene(shapes={}), "at least one shape"),
        (lambda: Scene(poses={}), "at least one"),
        (lambda: scene.sample_object(4, rng), r"\[0, 4\), got 4"),
        (lambda: scene.press(thing, 6, rng), "pose"),
        (lambda: scene.press(replace(thing, scale=0.0), 0, rng), "(?i)size|scale"),
        (lambda: Scene().press(replace(thing, scale=5.0), 0, rng), "(?i)size|scale"),
    ):
        with pytest.raises(ValueError, match=words):
            call()
