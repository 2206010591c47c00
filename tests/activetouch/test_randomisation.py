"""A randomised scene varies more than the scene, and contains it; drawn faults are drawn anew in every touch."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from activetouch import SCENES
from activetouch.distributions import Constant, Mixture, Uniform
from activetouch.randomisation import assumed, randomised
from activetouch.rendering import DrawnDeadTaxels, DrawnNoise, Noise
from belief.errors import InvalidArgument

QUANTITIES = ("size", "force", "friction", "stiffness")


@pytest.mark.parametrize("name", list(SCENES))
def test_a_randomised_scene_contains_the_scene(name):
    scene = SCENES[name].scene
    wide = randomised(scene)
    for quantity in QUANTITIES:
        (low, high), (wide_low, wide_high) = (getattr(s.variation, quantity).support for s in (scene, wide))
        assert wide_low <= low <= high <= wide_high
        assert wide_low < wide_high
        assert wide_low > 0.0
    assert bool(wide.faults) == bool(scene.faults)
    assert (wide.shapes, wide.poses, wide.pad, wide.renderer) == (scene.shapes, scene.poses, scene.pad, scene.renderer)


@pytest.mark.parametrize("name", ["coarse", "gel"])
def test_half_of_all_forces_noises_and_broken_taxels_are_those_of_the_scene(name, rng):
    scene = SCENES[name].scene
    wide = randomised(scene)
    (low, high), (smallest, largest) = scene.variation.force.support, wide.variation.force.support
    assert (smallest, largest) == pytest.approx((low / 1.5, 2.0 * high))
    # Half the forces are of the scene, and some of the others by chance: those that a log-uniform draw puts there.
    within = 0.5 + 0.5 * np.log(high / low) / np.log(largest / smallest)
    forces = np.array([wide.variation.force.sample(rng) for _ in range(2000)])
    assert stats.binomtest(int(((forces >= low) & (forces <= high)).sum()), 2000, within).pvalue > 1e-4
    *_, dead = wide.faults
    assert len(wide.faults) == len(scene.faults) + 1
    shares = np.array([np.mean(dead(np.ones((20, 20)), rng) == 0.0) for _ in range(400)])
    assert stats.binomtest(int((shares == 0.0).sum()), 400, 0.5).pvalue > 1e-4
    assert 0.15 < shares.max() <= 0.2
    noises = [fault.factor for fault in wide.faults if isinstance(fault, DrawnNoise)]
    assert len(noises) == sum(isinstance(fault, Noise) for fault in scene.faults) == 1
    factors = np.array([noises[0].sample(rng) for _ in range(400)])
    assert stats.binomtest(int((factors == 1.0).sum()), 400, 0.5).pvalue > 1e-4
    assert 2.5 < factors.max() <= 3.0


@pytest.mark.parametrize("quantity", ["friction", "stiffness"])
@pytest.mark.parametrize("value", [0.1, 3.0])
def test_a_number_that_the_scene_says_is_within_the_wider_range(quantity, value):
    scene = SCENES["coarse"].scene
    low, high = getattr(
        randomised(replace(scene, variation=replace(scene.variation, **{quantity: Constant(value)}))).variation,
        quantity,
    ).support
    assert low <= value <= high
    assert low < high


def test_half_of_the_noises_are_those_of_the_scene(rng):
    fault = DrawnNoise(0.1, Mixture(Constant(1.0), Constant(3.0)))
    spreads = np.array([fault(np.zeros((64, 64)), rng).std() for _ in range(200)])
    assert 60 < np.sum(np.abs(spreads - 0.1) < 0.02) < 140
    assert np.sum(np.abs(spreads - 0.3) < 0.05) == 200 - np.sum(np.abs(spreads - 0.1) < 0.02)


def test_other_taxels_are_dead_in_every_touch(rng):
    fault = DrawnDeadTaxels(Uniform(0.25, 0.25))
    images = np.array([fault(np.ones((4, 4)), rng) for _ in range(50)])
    assert ((images == 0).sum(axis=(1, 2)) == 4).all()
    assert (images.mean(axis=0) < 1).all()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: DrawnNoise(-0.1, Constant(1.0)), "std must be finite"),
        (lambda: DrawnNoise(np.inf, Constant(1.0)), "std must be finite"),
        (lambda: DrawnNoise(0.1, Uniform(-1.0, 1.0)), "factor must be ≥ 0"),
        (lambda: DrawnDeadTaxels(Uniform(0.5, 1.5)), r"share must be in \[0, 1\]"),
        (lambda: Mixture(Constant(1.0), Constant(2.0), 1.5), r"share must be in \[0, 1\]"),
    ],
)
def test_settings_out_of_range_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_most_of_what_a_belief_assumes_is_what_the_scene_says(rng):
    vary = SCENES["coarse"].scene.variation
    found = assumed(vary)
    drawn = np.array([found.stiffness.sample(rng) for _ in range(2000)])
    assert 0.5 < np.mean(drawn == 1.0) < 0.7
    assert drawn.min() < 0.6
    assert drawn.max() > 1.8
    assert assumed(vary, Constant(0.7)).stiffness == Constant(0.7)


def test_a_scene_without_force_is_not_randomised():
    scene = SCENES["coarse"].scene
    with pytest.raises(InvalidArgument, match="forces above zero"):
        randomised(replace(scene, variation=replace(scene.variation, force=Uniform(0.0, 2.0))))
