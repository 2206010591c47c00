"""Training by contrast learns ratios of likelihoods, and labels turn with their images."""

import numpy as np
import pytest
import torch

from activetouch import Quasistatic, Scene
from activetouch.perception.augmentation import augment
from activetouch.perception.hypothesis_network import Hypotheses, compose, rotation_matrices
from activetouch.perception.objective import jittered, turned
from activetouch.placement import Placement
from activetouch.poses import multiply, random_orientation, to_matrix
from activetouch.pressing.pad import Pad
from activetouch.scene import Symmetry

pytestmark = pytest.mark.torch
SCENE = Scene(pad=Pad(num_taxels=32), press_model=Quasistatic())


def image_of(orientation):
    placement = Placement(SCENE.solids["cone"], 1.0, np.asarray(orientation, float))
    return SCENE.image(SCENE.press_model.press(SCENE.setup, placement, 2.0))


@pytest.mark.parametrize("seed", range(4))
def test_a_turned_image_is_the_image_of_the_turned_object(seed, rng):
    """A quarter turn as augmentation makes it, against a press of the object in its new orientation."""
    orientation = torch.from_numpy(random_orientation(rng)).float()[None]
    image = torch.from_numpy((255 * image_of(orientation[0])).round().astype(np.uint8))[None]
    chance = torch.Generator().manual_seed(seed)
    shown, angles = augment(image, Symmetry.ROTATIONS, 0.0, chance)
    kinds, sizes = torch.zeros(1, dtype=torch.long), torch.ones(1)
    orientation = turned(Hypotheses(kinds, orientation, sizes), angles).orientations
    pressed = (255 * image_of(orientation[0])).round()
    assert np.abs(pressed - shown[0].numpy()).max() <= 2
    if float(angles[0]):
        assert np.abs(pressed - image[0].numpy()).max() > 10


def test_small_rotations_turn_the_label_the_same_way(rng):
    orientation = torch.from_numpy(random_orientation(rng)).float()[None]
    image = torch.from_numpy((255 * image_of(orientation[0])).round().astype(np.uint8))[None]
    shown, angles = augment(image, Symmetry.ROTATIONS, 30.0, torch.Generator().manual_seed(1))
    there = turned(Hypotheses(torch.zeros(1, dtype=torch.long), orientation, torch.ones(1)), angles).orientations
    back = turned(Hypotheses(torch.zeros(1, dtype=torch.long), orientation, torch.ones(1)), -angles).orientations
    errors = [np.abs(255 * image_of(there_or_back[0]) - shown[0].numpy()).mean() for there_or_back in (there, back)]
    assert errors[0] < 0.3 * errors[1]


def test_rotations_in_torch_are_those_of_the_poses(rng):
    first, second = random_orientation(rng), random_orientation(rng)
    product = compose(*(torch.from_numpy(q)[None] for q in (first, second)))
    assert np.allclose(product[0], multiply(first, second))
    assert np.allclose(rotation_matrices(product)[0], to_matrix(multiply(first, second)))


def test_cells_have_the_stated_spread():
    still = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(20_000, 1)
    moved = jittered(still, np.deg2rad(5.0), torch.Generator().manual_seed(0))
    assert torch.allclose(moved.norm(dim=1), torch.ones(len(moved)), atol=1e-5)
    angles = 2 * moved[:, 1:] / moved[:, :1]
    assert np.rad2deg(angles.std(dim=0).numpy()) == pytest.approx([5.0] * 3, rel=0.03)
