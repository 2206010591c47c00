"""Many presses at once are the presses one by one."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch.distributions import Constant
from activetouch.named_scenes import SCENES
from activetouch.pressing.press import Quasistatic
from activetouch.scene import Variation
from benchmarks.bayes_error.press_draws import PressDraws, PressSampler, ideal_presses

SCENE = SCENES["coarse"].scene


@pytest.mark.parametrize("shape", range(4))
def test_images_are_those_of_quasistatic_presses(shape, rng):
    sampler = PressSampler(SCENE.variation, 5, 3)
    for pose in range(3):
        placement = SCENE.place(replace(SCENE.sample_object(shape, rng), stiffness=0.7), pose, rng)
        draws = sampler.sample(rng)
        found = ideal_presses(SCENE, placement, draws).reshape(5, 3, 4, 4)
        for j, f in np.ndindex(5, 3):
            placed = replace(placement, offset=draws.offsets[j])
            contact = Quasistatic().press(SCENE.setup, placed, draws.forces[j, f])
            np.testing.assert_allclose(found[j, f], SCENE.image(contact), atol=1e-12)


@pytest.mark.filterwarnings("error")
def test_misses_no_force_and_the_bottom_of_the_layer(rng):
    placement = SCENE.place(SCENE.sample_object(0, rng), 0, rng)
    draws = PressDraws(np.array([[0.0, 0.0], [0.0, 1.0]]), np.array([[0.0, 2.0, 1e9], [0.0, 2.0, 1e9]]))
    found = ideal_presses(SCENE, placement, draws).reshape(2, 3, 4, 4)
    assert not found[:, 0].any(), "no force, no image"
    assert not found[1].any(), "a metre beside the pad"
    contact = Quasistatic().press(SCENE.setup, replace(placement, offset=np.zeros(2)), 1e9)
    assert contact.is_bottomed_out
    np.testing.assert_allclose(found[0, 2], SCENE.image(contact), atol=1e-12)


def test_draws_have_the_law_of_the_scene(rng):
    sampler = PressSampler(SCENE.variation, 8, 4)
    draws = [sampler.sample(rng) for _ in range(500)]
    offsets, forces = np.concatenate([d.offsets for d in draws]), np.concatenate([d.forces for d in draws])
    for drawn, low, high in (
        (offsets[:, 0], -0.002, 0.002),
        (offsets[:, 1], -0.002, 0.002),
        (forces.ravel(), 1.5, 3.0),
    ):
        shares = (np.sort(drawn) - low) / (high - low)
        even = (np.arange(len(drawn)) + 0.5) / len(drawn)
        assert np.abs(shares - even).max() < 0.03
    counts = np.stack([np.bincount(((f - 1.5) / 0.375).astype(int), minlength=4) for f in forces])
    assert np.mean(counts == 1) > 0.95, "one force in each stratum, up to the sample's error"


def test_the_two_offsets_of_a_press_do_not_go_together(rng):
    sampler = PressSampler(SCENE.variation, 1, 1)
    drawn = np.concatenate([sampler.sample(rng).offsets for _ in range(2000)])
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 5 / np.sqrt(2000)  # fails once in a million


def test_what_does_not_vary_is_drawn_as_it_is(rng):
    fixed = Variation(offset=Constant(0.001), force=Constant(2.0))
    draws = PressSampler(fixed, 3, 2).sample(rng)
    assert (draws.offsets == 0.001).all()
    assert (draws.forces == 2.0).all()
