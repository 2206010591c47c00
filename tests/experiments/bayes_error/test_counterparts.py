"""Counterparts are real presses within the scene's ranges; refinement never harms; no twin is invented."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch.distributions import Constant, LogUniform, Normal, Uniform
from activetouch.errors import UnknownLikelihood
from activetouch.placement import Placement
from activetouch.poses import multiply, turn
from activetouch.pressing.pad import Pad
from activetouch.rendering import Gain, GelSightRenderer, Noise
from activetouch.scene import Scene, Symmetry
from activetouch.shapes import EXTENDED_SHAPES, SHAPES
from experiments.bayes_error.counterparts import (
    Pressing,
    Sensing,
    Start,
    Target,
    bank_slice,
    block_means,
    find_counterpart,
    nearest_starts,
    refine,
    sketched,
)

SCENE = Scene(shapes=EXTENDED_SHAPES, pad=Pad(num_taxels=64))
LABELS = SCENE.shape_labels


def pressing(label, orientation, scale=1.0, force=2.0, offset=(0.0, 0.0)):
    return Pressing(Placement(EXTENDED_SHAPES[label], scale, orientation, np.array(offset)), force)


def drawn(label, rng):
    placement = SCENE.place(SCENE.sample_object(LABELS.index(label), rng), 0, rng)
    return Pressing(placement, SCENE.variation.force.sample(rng))


def test_the_same_press_has_no_distance_whatever_the_gain(rng):
    image = drawn("cone", rng).image(SCENE)
    assert Sensing.of(SCENE).distance(1.07 * image, image) == pytest.approx(0.0, abs=1e-9)


def test_the_distance_is_the_difference_in_units_of_noise(rng):
    sensing = Sensing(0.0, 0.02)
    first, second = rng.uniform(size=(2, 8, 8))
    assert sensing.distance(first, second) == pytest.approx(np.sqrt(((first - second) ** 2).sum()) / 0.02)


def test_a_gain_beyond_its_range_leaves_a_distance():
    image = np.full((4, 4), 0.5)
    assert Sensing(0.1, 0.02).distance(image, 0.5 * image) == pytest.approx(4 * (0.5 - 1.1 * 0.25) / 0.02)


def test_the_best_gain_is_found(rng):
    image, ideal = rng.uniform(size=(2, 6, 6))
    sensing = Sensing(0.3, 0.02)
    least = min(np.linalg.norm(image - gain * ideal) for gain in np.linspace(0.7, 1.3, 601)) / 0.02
    assert sensing.distance(image, ideal) <= least + 1e-9


def test_a_search_finds_the_press_it_was_moved_from(rng):
    for label in ("cone", "capsule", "hexagonal_prism"):
        own = drawn(label, rng)
        nudged = replace(own.placement, orientation=multiply(turn("y", 0.01), own.placement.orientation))
        start = Start(Target.of(SCENE, own, 1.0), Pressing(nudged, own.force))
        before = Sensing.of(SCENE).distance(start.target.image, start.pressing.image(SCENE))
        assert find_counterpart(SCENE, [start]).distance < 1.0 < before


def test_refinement_never_goes_further_away(rng):
    sensing = Sensing.of(SCENE)
    for label, other in (("cube", "sphere"), ("cone", "torus"), ("wedge", "cuboid"), ("cylinder", "ellipsoid")):
        image, start = drawn(label, rng).image(SCENE), drawn(other, rng)
        for stride in (1.0, 10.0):
            found = refine(SCENE, image, start, stride)
            assert found.distance <= sensing.distance(image, start.image(SCENE))
            assert found.distance == pytest.approx(sensing.distance(image, found.pressing.image(SCENE)))


def test_counterparts_are_presses_the_scene_could_make(rng):
    image = drawn("cuboid", rng).image(SCENE)
    for _ in range(3):
        found = refine(SCENE, image, drawn("cube", rng), 10.0).pressing
        vary, placement = SCENE.variation, found.placement
        assert placement.shape is EXTENDED_SHAPES["cube"]
        assert np.linalg.norm(placement.orientation) == pytest.approx(1.0)
        for value, among in (
            (placement.scale, vary.size),
            (placement.offset[0], vary.offset),
            (placement.offset[1], vary.offset),
            (found.force, vary.force),
        ):
            assert among.low <= value <= among.high
        assert (placement.friction, placement.stiffness) == (1.0, 1.0)  # constant in this scene


def test_a_cuboid_on_its_square_face_is_a_counterpart_of_a_cube(rng):
    # Their square faces are alike, and only these meet the pad.
    face = pressing("cube", turn("x", 0.3))
    side = pressing("cuboid", multiply(turn("x", 0.3), turn("y", np.pi / 2)), force=2.2)
    found = refine(SCENE, face.image(SCENE), side)
    assert found.distance < 0.1


def test_a_cube_on_its_face_has_no_counterpart_among_spheres(rng):
    target = Target.of(SCENE, pressing("cube", turn("x", 0.0)), 1.0)
    _, _, pressings, images = bank_slice(SCENE, LABELS.index("sphere"), 0, 100, 0)
    starts = nearest_starts(target.views(Symmetry.ROTATIONS_AND_MIRROR), pressings, images, Sensing.of(SCENE), 3)
    assert find_counterpart(SCENE, starts).distance > 50.0


def test_a_press_is_found_again_in_a_bank_that_holds_it():
    number = 37
    _, _, pressings, images = bank_slice(SCENE, LABELS.index("wedge"), 0, 200, 0)
    target = Target.of(SCENE, pressings[number], 0.93)
    starts = nearest_starts(target.views(Symmetry.ROTATIONS_AND_MIRROR), pressings, images, Sensing.of(SCENE), 2)
    assert starts[0].pressing is pressings[number]
    assert find_counterpart(SCENE, starts).distance < 0.1


def test_a_turned_press_starts_from_the_view_it_is_like():
    # 64 taxels leave the views of the sketch exact images of turned presses.
    _, _, pressings, images = bank_slice(SCENE, LABELS.index("cone"), 0, 100, 0)
    placement = pressings[5].placement
    offset = np.array([-placement.offset[1], placement.offset[0]])  # a quarter turn about the approach axis
    turned = replace(placement, orientation=multiply(turn("x", np.pi / 2), placement.orientation), offset=offset)
    target = Target.of(SCENE, Pressing(turned, pressings[5].force), 1.0)
    best = nearest_starts(target.views(Symmetry.ROTATIONS), pressings, images, Sensing.of(SCENE), 1)[0]
    assert best.pressing is pressings[5]
    assert best.target.image is not target.image
    assert Sensing.of(SCENE).distance(best.target.image, best.pressing.image(SCENE)) < 0.1


def test_a_sketch_tells_as_much_as_the_whole(rng):
    # A smooth difference has the same distance on both pads, but for the edges of the contact.
    sensing, coarse = Sensing.of(SCENE), sketched(SCENE, 32)
    first, second = pressing("sphere", turn("x", 0.0)), pressing("sphere", turn("x", 0.0), scale=1.05)
    whole = sensing.distance(first.image(SCENE), second.image(SCENE))
    assert Sensing.of(coarse).distance(first.image(coarse), second.image(coarse)) == pytest.approx(whole, rel=0.1)


def test_images_in_colour_have_counterparts_too(rng):
    scene = replace(SCENE, renderer=GelSightRenderer(), faults=(Noise(0.02),))
    own = drawn("cone", rng)
    start = Start(Target.of(scene, own, 1.0), Pressing(own.placement, own.force + 0.05))
    assert find_counterpart(scene, [start]).distance < 1.0


@pytest.mark.parametrize("faults", [(), (Gain(0.1),), (Gain(0.1), Gain(0.1), Noise(0.1)), (Noise(0.0),)])
def test_without_noise_there_is_no_distance(faults):
    with pytest.raises(UnknownLikelihood, match="got"):
        Sensing.of(replace(SCENE, faults=faults))


@pytest.mark.parametrize("distribution", [Constant(1.5), Uniform(1.0, 2.0), LogUniform(0.5, 2.0), Normal(1.0, 0.1)])
def test_draws_stay_within_the_support(distribution, rng):
    low, high = distribution.support
    assert all(low <= distribution.sample(rng) <= high for _ in range(200))


def test_block_means_keep_the_mean(rng):
    images = rng.uniform(size=(3, 8, 8))
    np.testing.assert_allclose(block_means(images, 4).mean(axis=(1, 2)), images.mean(axis=(1, 2)))


def test_shapes_of_the_scene_have_their_images(rng):
    for label in SHAPES:
        _, _, pressings, images = bank_slice(SCENE, LABELS.index(label), 0, 3, 0)
        assert len(pressings) == 3
        assert images.shape == (3, 256)
        assert images.max() > 0.0
