"""Every renderer obeys the same laws, and every fault does what its name says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activetouch.placement import Placement
from activetouch.poses import multiply, random_orientation, turn
from activetouch.pressing.contact import elastic_contact, surface_gap
from activetouch.pressing.guarded_move import GuardedMove
from activetouch.pressing.pad import Pad
from activetouch.pressing.setup import Setup
from activetouch.rendering import (
    RENDERERS,
    DeadTaxels,
    ForcePatchRenderer,
    Gain,
    GelSightRenderer,
    Hysteresis,
    Noise,
    PressureRenderer,
    Quantisation,
    read_out,
)
from activetouch.shapes import EXTENDED_SHAPES, SHAPES

PAD = Pad(num_taxels=64)
FAULTS = [Gain(0.1), Noise(0.02), DeadTaxels(0.05), Quantisation(4), Hysteresis(0.05)]
every_renderer = pytest.mark.parametrize("name", list(RENDERERS))
every_fault = pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: type(fault).__name__)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def press(shape, orientation=UPRIGHT, force=2.0, offset=(0.0, 0.0), pad=PAD):
    gap = surface_gap(pad, Placement(shape, 1.0, orientation, np.array(offset)))
    return elastic_contact(pad, gap, force)


@every_renderer
@pytest.mark.parametrize("shape", list(EXTENDED_SHAPES))
def test_an_image_is_square_and_between_zero_and_one(name, shape, rng):
    image = RENDERERS[name](press(EXTENDED_SHAPES[shape], random_orientation(rng)))
    assert image.shape[:2] == (64, 64)
    assert image.ndim == 2 or image.shape[2] == 3
    assert image.min() >= 0.0
    assert image.max() <= 1.0


@every_renderer
def test_a_miss_looks_like_no_touch_at_all(name):
    missed = RENDERERS[name](press(SHAPES["sphere"], offset=(0.05, 0.0)))
    untouched = RENDERERS[name](press(SHAPES["sphere"], force=0.0))
    np.testing.assert_array_equal(missed, untouched)
    assert np.ptp(missed, axis=(0, 1)).max() == 0.0


@pytest.mark.parametrize("name", [name for name, renderer in RENDERERS.items() if renderer.isotropic])
@given(st.integers(0, 2**32 - 1), st.sampled_from(list(SHAPES)))
def test_an_isotropic_renderer_turns_its_image_with_the_object(name, seed, shape):
    orientation = random_orientation(np.random.default_rng(seed))
    before = RENDERERS[name](press(SHAPES[shape], orientation))
    after = RENDERERS[name](press(SHAPES[shape], multiply(turn("x", np.pi / 2), orientation)))
    np.testing.assert_allclose(after, np.rot90(before, -1), atol=1 / 100)  # a colour map has 256 steps


@pytest.mark.parametrize("name", [name for name, renderer in RENDERERS.items() if not renderer.isotropic])
def test_a_renderer_with_a_direction_does_not_turn_with_the_object(name, rng):
    orientation = random_orientation(rng)
    before = RENDERERS[name](press(SHAPES["cube"], orientation))
    after = RENDERERS[name](press(SHAPES["cube"], multiply(turn("x", np.pi / 2), orientation)))
    assert np.abs(after - np.rot90(before, -1)).max() > 0.1


def test_a_symmetric_object_gives_a_mirror_symmetric_image(rng):
    for shape in (SHAPES["cylinder"], SHAPES["cone"], EXTENDED_SHAPES["wedge"]):
        # Tilted about y only, every one of these is its own mirror image in the plane y = 0.
        image = PressureRenderer()(press(shape, turn("y", rng.uniform(0.0, np.pi))))
        np.testing.assert_allclose(image, image[:, ::-1], atol=1e-9)


def test_a_coarse_array_reads_the_mean_pressure_on_each_taxel(rng):
    contact = press(SHAPES["cone"], random_orientation(rng))
    coarse = PressureRenderer(binning=16)(contact)
    assert coarse.shape == (4, 4)
    np.testing.assert_allclose(coarse.mean(), PressureRenderer()(contact).mean())
    with pytest.raises(ValueError, match="binning must divide the pad's 64 points"):
        PressureRenderer(binning=7)(contact)


def test_a_slope_towards_a_light_is_brighter_in_its_colour():
    image = GelSightRenderer()(press(SHAPES["sphere"]))
    flat = GelSightRenderer().brightness
    red_by_row = image[:, 32, 0]
    # Red light comes from +z (last rows). The wall of the dent that looks towards it is on the far side, at small z.
    assert red_by_row[24] > flat > red_by_row[40]
    np.testing.assert_allclose(image[0, 0], flat)


def test_a_stronger_force_draws_a_larger_patch():
    sizes = [(ForcePatchRenderer()(press(SHAPES["sphere"], force=f))[:, :, 1] > 0.5).sum() for f in (1.0, 2.0, 4.0)]
    assert sizes[0] < sizes[1] < sizes[2]


def test_the_patch_lies_where_the_force_acts():
    image = ForcePatchRenderer()(press(SHAPES["sphere"], offset=(0.006, -0.003)))
    row, column = np.unravel_index(image[:, :, 1].argmax(), (64, 64))
    z, y = (np.array([row, column]) + 0.5) / 64 * 0.030 - 0.015
    assert (y, z) == pytest.approx((0.006, -0.003), abs=0.0015)


@pytest.mark.mujoco
def test_a_window_slides_over_a_press():
    placement = Placement(SHAPES["cube"], 1.0, turn("z", 0.3))
    contact = GuardedMove().press(Setup(PAD), placement, 1.0)
    windows = list(ForcePatchRenderer().windows(contact, stride=0.02))
    assert len(windows) > 5
    assert all(window.shape == (64, 64, 3) for window in windows)
    with pytest.raises(ValueError, match="no trace"):
        next(ForcePatchRenderer().windows(press(SHAPES["cube"]), stride=0.02))


@every_fault
@pytest.mark.parametrize("shape", [(1, 1), (4, 4), (16, 16, 3)])
def test_a_fault_keeps_the_shape_and_leaves_its_input_alone(fault, shape, rng):
    image = rng.uniform(size=shape)
    copy = image.copy()
    assert fault(image, rng).shape == shape
    np.testing.assert_array_equal(image, copy)


def test_dead_taxels_are_the_same_in_every_touch(rng):
    fault = DeadTaxels(0.1, seed=3)
    dead = [fault(rng.uniform(0.1, 1.0, (20, 20)), rng) == 0.0 for _ in range(3)]
    assert dead[0].sum() == 40
    assert (dead[0] == dead[1]).all()
    assert (dead[0] == dead[2]).all()
    assert (DeadTaxels(0.1, seed=4)(np.ones((20, 20)), rng) == 0.0).sum() == 40


def test_gain_scales_the_whole_image(rng):
    ratios = [Gain(0.1)(np.full((3, 3), 0.5), rng) / 0.5 for _ in range(50)]
    assert all(np.ptp(ratio) < 1e-12 for ratio in ratios)
    assert 0.9 <= np.min(ratios) < 0.95
    assert 1.05 < np.max(ratios) <= 1.1


def test_noise_has_the_standard_deviation_it_says(rng):
    assert Noise(0.02)(np.full((200, 200), 0.5), rng).std() == pytest.approx(0.02, rel=0.02)


def test_quantisation_leaves_so_many_levels(rng):
    assert len(np.unique(Quantisation(3)(rng.uniform(size=(50, 50)), rng))) == 8


def test_hysteresis_swallows_light_pressure(rng):
    np.testing.assert_allclose(Hysteresis(0.1)(np.array([[0.05, 0.1, 0.5]]), rng), [[0.0, 0.0, 0.4]])


def test_faults_are_applied_in_turn_and_end_in_eight_bits(rng):
    image = np.array([[0.0, 0.5], [0.9, 1.0]])
    read = read_out(image, (Hysteresis(0.1), Quantisation(1)), rng)
    assert read.dtype == np.uint8
    np.testing.assert_array_equal(read, [[0, 0], [255, 255]])
    np.testing.assert_array_equal(read_out(2 * image - 0.5, (), rng), [[0, 128], [255, 255]])


@pytest.mark.parametrize("wrong", [lambda: DeadTaxels(1.5), lambda: Quantisation(0)])
def test_a_fault_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValueError, match="must be in"):
        wrong()
