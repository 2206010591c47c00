"""Every renderer obeys the same laws, and every fault does what its name says."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from activetouch.poses import Placement, multiply, random_orientation, turn
from activetouch.pressing.contact import Pad, Phase, Trace, elastic_contact, surface_gap
from activetouch.rendering import (
    RENDERERS,
    Blur,
    DeadTaxels,
    ForcePatchRenderer,
    Gain,
    GelSightRenderer,
    Hysteresis,
    Noise,
    PressureRenderer,
    Quantisation,
    Shift,
    StuckTaxels,
    read_out,
)
from activetouch.shapes import EXTENDED_SHAPES, SHAPES

PAD = Pad(num_taxels=64)
FAULTS = [
    *(Gain(0.1), Noise(0.02), DeadTaxels(0.05), Quantisation(4), Hysteresis(0.05)),
    *(StuckTaxels(0.1), Shift(1, -3), Shift(columns=1), Blur(0.0), Blur(1.0)),
]
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


def test_a_coarse_array_reads_the_mean_pressure_on_each_taxel(rng):
    contact = press(SHAPES["cone"], random_orientation(rng))
    coarse = PressureRenderer(binning=16)(contact)
    assert coarse.shape == (4, 4)
    np.testing.assert_allclose(coarse.mean(), PressureRenderer()(contact).mean())
    assert coarse[1, 2] == pytest.approx(PressureRenderer()(contact)[16:32, 32:48].mean())
    several = np.stack([contact.pressure, 2.0 * contact.pressure, contact.pressure.T]).reshape(3, 1, 64, 64)
    means = PressureRenderer(binning=16).mean_pressure(several)
    one = PressureRenderer(binning=16).mean_pressure(contact.pressure)
    np.testing.assert_allclose(means, np.stack([one, 2.0 * one, one.T])[:, None])
    with pytest.raises(ValueError, match="binning must divide the pad's 64 points"):
        PressureRenderer(binning=7)(contact)


@pytest.mark.parametrize("elevation", np.deg2rad([30.0, 45.0, 70.0]))
def test_a_tilted_plane_is_as_bright_as_lamberts_law_says(elevation):
    """A light of azimuth a and elevation e shines on a plane of normal n with n · (cos a cos e, sin a cos e, sin e)."""
    pad = Pad(num_taxels=48)
    up_y, up_z = -0.10, 0.15  # slopes of the membrane, whose height is minus the indentation
    depth = 0.01 - up_y * pad.taxel_centres[1] - up_z * pad.taxel_centres[2]
    image = GelSightRenderer(elevation=elevation)(
        replace(press(SHAPES["cube"], pad=pad), indentation=depth.reshape(48, 48))
    )
    normal = np.array([-up_y, -up_z, 1.0]) / np.sqrt(1.0 + up_y**2 + up_z**2)
    for colour, azimuth in enumerate(np.deg2rad([90.0, 210.0, 330.0])):
        light = [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
        expected = GelSightRenderer().brightness * (normal @ light) / np.sin(elevation)
        np.testing.assert_allclose(image[10:-10, 10:-10, colour], expected, rtol=1e-9)


def traced(phases, force, point, timestep=0.01):
    """A contact whose trace has these phases, forces along x and contact points."""
    steps = len(force)
    forces, points = np.zeros((steps, 3)), np.column_stack([point, np.zeros(steps)])
    forces[:, 0] = force
    trace = Trace(timestep * np.arange(1, steps + 1), np.zeros((steps, 3)), forces, points, phases)
    return replace(press(SHAPES["sphere"]), trace=trace)


@pytest.mark.parametrize("steps_of_a_stride", [1, 2, 3, 7])
def test_windows_end_every_stride_from_the_first_to_the_last_step_in_contact(steps_of_a_stride):
    num_before, num_touched = 4, 12
    force = np.concatenate([np.zeros(num_before), np.linspace(0.5, 3.0, num_touched), np.zeros(5)])
    point = np.linspace(-0.010, 0.010, len(force))
    renderer = ForcePatchRenderer(window=0.03)
    found = list(renderer.windows(traced([Phase.CONTACT] * len(force), force, point), 0.01 * steps_of_a_stride))
    ends = range(num_before + 1, num_before + num_touched + 1, steps_of_a_stride)
    assert len(found) == len(ends)
    for window, end in zip(found, ends, strict=True):  # as if the press had paused there
        phases = [Phase.CONTACT] * (end - 1) + [Phase.PAUSE] + [Phase.WITHDRAW] * (len(force) - end)
        np.testing.assert_array_equal(window, renderer(traced(phases, force, point)))


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


def test_stuck_taxels_read_their_level_and_the_others_what_they_feel(rng):
    image = rng.uniform(0.1, 0.9, (20, 20))
    read, dead = StuckTaxels(0.1, seed=3)(image, rng), DeadTaxels(0.1, seed=3)(image, rng) == 0.0
    np.testing.assert_array_equal(read, np.where(dead, 1.0, image))
    assert (StuckTaxels(1 / 16, level=0.5)(np.zeros((4, 4)), rng) == 0.5).sum() == 1


@pytest.mark.parametrize(("rows", "columns"), [(0, 0), (1, 0), (0, -2), (-3, 1), (4, 0), (-9, 0), (10**20, 1)])
def test_a_shift_moves_every_taxel_by_as_much_and_shows_nothing_beyond_the_edge(rows, columns, rng):
    image = rng.uniform(0.1, 1.0, (4, 5, 3))
    shifted = Shift(rows, columns)(image, rng)
    for row, column in np.ndindex(4, 5):
        here = 0 <= row - rows < 4 and 0 <= column - columns < 5
        np.testing.assert_array_equal(shifted[row, column], image[row - rows, column - columns] if here else 0.0)


def test_a_blur_keeps_the_force_inside_and_the_colours_apart(rng):
    image = np.zeros((41, 41, 3))
    image[20, 20, 0] = 1.0
    blurred = Blur(2.0)(image, rng)
    assert blurred[..., 0].sum() == pytest.approx(1.0)
    assert blurred[20, 22, 0] / blurred[20, 20, 0] == pytest.approx(np.exp(-0.5), rel=1e-3)
    assert not blurred[..., 1:].any()


def test_noise_has_the_standard_deviation_it_says(rng):
    assert Noise(0.02)(np.full((200, 200), 0.5), rng).std() == pytest.approx(0.02, rel=0.02)


def test_faults_are_applied_in_turn_and_end_in_eight_bits(rng):
    image = np.array([[0.0, 0.5], [0.9, 1.0]])
    read = read_out(image, (Hysteresis(0.1), Quantisation(1)), rng)
    assert read.dtype == np.uint8
    np.testing.assert_array_equal(read, [[0, 0], [255, 255]])
    np.testing.assert_array_equal(read_out(2 * image - 0.5, (), rng), [[0, 128], [255, 255]])


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: DeadTaxels(1.5),
        lambda: Quantisation(0),
        lambda: StuckTaxels(np.nan),
        lambda: StuckTaxels(0.1, level=2.0),
        lambda: Shift(0.5),
        lambda: Shift(columns=np.nan),
        lambda: Blur(-1.0),
        lambda: Blur(np.inf),
        lambda: Noise(np.nan),
        lambda: Gain(-0.1),
        lambda: Hysteresis(np.nan),
        lambda: PressureRenderer(binning=0),
    ],
)
def test_a_fault_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        wrong()
