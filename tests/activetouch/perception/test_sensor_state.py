"""A reader of any object knows the state of the sensor that a scene says, within the limits of its training."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES
from activetouch.distributions import Constant, Uniform
from activetouch.perception.imaging import (
    BROKEN,
    LIMITS,
    STATE_SIZE,
    Imaging,
    differs_from_training,
    fields_read,
    imaging_of,
    sensor_state,
)
from activetouch.rendering import (
    Blur,
    DeadTaxels,
    Gain,
    Hysteresis,
    Noise,
    PressureRenderer,
    Quantisation,
    Shift,
    StuckTaxels,
)
from activetouch.scene_description import scene_differences, scene_fields

GEL, COARSE, PAPER = (SCENES[name].scene for name in ("gel", "coarse", "paper"))
IMAGING = imaging_of(GEL)


def varied(scene=GEL, **changes):
    return replace(scene, variation=replace(scene.variation, **changes))


def faulty(*faults, scene=GEL):
    return replace(scene, faults=(*scene.faults, *faults))


def taxels(number, **pad):
    return replace(GEL, pad=replace(GEL.pad, num_taxels=number, **pad))


def unknown(scene, own=GEL):
    """How a scene differs from all that the reader of another one can know, in paths of fields."""
    imaging, here = imaging_of(own), scene_fields(scene)
    read = fields_read(imaging, scene_fields(own), scene, here)
    return [difference.path for difference in scene_differences(read, here)]


TOLD = {
    "noise": (replace(GEL, faults=(Gain(0.1), Noise(0.04))), "noise", 2.0),
    "force": (varied(force=Uniform(0.75, 1.5)), "force", 0.5),
    "a constant force": (varied(force=Constant(4.5)), "force", 2.0),
    "stiffness of the objects": (varied(stiffness=Constant(0.5)), "stiffness", 0.5),
    "stiffness of the pad": (taxels(128, stiffness=1.5 * GEL.pad.stiffness), "stiffness", 1.5),
    "a shift": (faulty(Shift(2, -4)), "shift", [2 / 128, -4 / 128]),
    "a blur": (faulty(Blur(2.56)), "blur", 0.02),
    "hysteresis": (faulty(Hysteresis(0.05)), "hysteresis", 0.05),
    "wider taxels": (replace(GEL, renderer=PressureRenderer(8)), "wide", 1.0),
    "dead taxels": (faulty(DeadTaxels(1.0)), "dead", np.ones((BROKEN, BROKEN))),
    "stuck taxels": (faulty(StuckTaxels(1.0)), "stuck", np.ones((BROKEN, BROKEN))),
}


@pytest.mark.parametrize("what", TOLD)
def test_a_change_of_the_sensor_is_in_its_state(what):
    scene, name, value = TOLD[what]
    world = sensor_state(IMAGING, scene)
    np.testing.assert_allclose(getattr(world, name)[0], value, rtol=1e-3)
    assert differs_from_training(IMAGING.fields(), scene)
    assert unknown(scene) == []


@pytest.mark.parametrize("scene", [GEL, COARSE])
def test_the_state_is_nominal_in_the_scene_that_a_reader_was_trained_in(scene):
    imaging = imaging_of(scene)
    assert not sensor_state(imaging, scene).code().any()
    assert not differs_from_training(imaging.fields(), scene)
    assert not differs_from_training(None, faulty(Blur(4.0)))
    assert unknown(scene, scene) == []


BEYOND = {
    "force": (varied(force=Constant(1e-3)), "force", 0, ["variation.force"]),
    "stiffness": (varied(stiffness=Constant(5.0)), "stiffness", 1, ["variation.stiffness.value"]),
    "stiffness of the pad": (taxels(128, stiffness=1e9), "stiffness", 1, ["pad.stiffness"]),
    "noise": (replace(GEL, faults=(Gain(0.1), Noise(0.5))), "noise", 1, ["faults.1.std"]),
    "blur": (faulty(Blur(64.0)), "blur", 1, ["faults"]),
    "shift": (faulty(Shift(64, 0)), "shift", 1, ["faults"]),
    "hysteresis": (faulty(Hysteresis(0.9)), "hysteresis", 1, ["faults"]),
}


@pytest.mark.parametrize("what", BEYOND)
def test_what_is_beyond_the_training_is_given_as_its_limit_and_stays_a_difference(what):
    scene, name, end, paths = BEYOND[what]
    assert getattr(sensor_state(IMAGING, scene), name).ravel()[0] == pytest.approx(LIMITS[name][end])
    assert unknown(scene) == paths


def test_what_no_state_can_say_stays_a_difference():
    assert unknown(faulty(Quantisation(4))) == ["faults"]
    assert unknown(faulty(StuckTaxels(0.1, level=0.5))) == ["faults"]
    assert unknown(replace(GEL, faults=(Gain(0.5), Noise(0.02)))) == ["faults.0.half_range"]
    assert unknown(replace(GEL, faults=(Gain(0.05), Noise(0.02)))) == []
    assert unknown(varied(offset=Uniform(-0.004, 0.004))) == ["variation.offset.low", "variation.offset.high"]
    assert unknown(varied(offset=Constant(0.0))) == []
    assert unknown(taxels(64, half_width=0.02)) == ["pad.half_width", "pad.num_taxels"]


EXTREME = {
    "no faults": replace(GEL, faults=()),
    "noise of zero": replace(GEL, faults=(Noise(0.0),)),
    "vast noise": replace(GEL, faults=(Noise(1e300),)),
    "tiny force": varied(force=Constant(0.0)),
    "vast force": varied(force=Constant(1e3)),
    "tiny stiffness": varied(stiffness=Constant(1e-6)),
    "vast stiffness": varied(stiffness=Uniform(1e5, 1e6)),
    "vast blur": faulty(Blur(1e300), Blur(1e300)),
    "vast shift": faulty(Shift(10**9, -(10**9))),
    "all taxels broken": faulty(DeadTaxels(1.0), StuckTaxels(1.0)),
    "one taxel": replace(taxels(1), faults=(Noise(0.1), DeadTaxels(1.0))),
    "one wide taxel": replace(GEL, renderer=PressureRenderer(128)),
    "three taxels": faulty(DeadTaxels(0.3), scene=taxels(3)),
    "seven taxels": faulty(StuckTaxels(0.3), scene=taxels(7)),
    "a prime number of taxels": taxels(37),
}


@pytest.mark.parametrize("own", ["gel", "coarse", "no noise", "one taxel"])
@pytest.mark.parametrize("what", EXTREME)
def test_a_state_is_always_a_number_within_the_limits(own, what):
    imaging = {
        "gel": IMAGING,
        "coarse": imaging_of(COARSE),
        "no noise": replace(IMAGING, noise=0.0, force=(0.0, 1.0)),
        "one taxel": imaging_of(EXTREME["one taxel"]),
    }[own]
    world = sensor_state(imaging, EXTREME[what])
    assert world.code().shape == (1, STATE_SIZE)
    assert np.isfinite(world.code()).all()
    for name, (low, high) in imaging.limits.items():
        assert (getattr(world, name) >= np.float32(low)).all()
        assert (getattr(world, name) <= np.float32(high)).all()
    for name in ("dead", "stuck"):
        assert ((getattr(world, name) >= 0) & (getattr(world, name) <= 1)).all()


@pytest.mark.torch
@pytest.mark.parametrize("number", [1, 3, 7, 30, 37, 64, 128])
def test_the_imaging_of_any_number_of_taxels_makes_images(number, rng):
    imaging = imaging_of(taxels(number))
    assert Imaging.from_fields(imaging.fields()) == imaging
    heights = rng.uniform(0.0, 0.001, (2, imaging.samples, imaging.samples)).astype(np.float32)
    heights[1] = -np.inf
    import torch

    from activetouch.perception.contacts.images import images

    state, random = sensor_state(imaging, taxels(number)), torch.Generator().manual_seed(0)
    read, hit = images(imaging, torch.from_numpy(heights), state, np.zeros(2, int), random)
    assert read.shape == (2, imaging.pixels, imaging.pixels)
    assert torch.isfinite(read).all()
    assert hit.tolist() == [True, False]
