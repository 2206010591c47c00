"""Augmentations are symmetries: nothing else changes, and nothing is done that the scene does not allow."""

import numpy as np
import pytest
import torch
from scipy import stats

from activetouch.perception.augmentation import augment
from activetouch.scene import Symmetry

pytestmark = pytest.mark.torch
IMAGES = torch.from_numpy(np.random.default_rng(0).integers(0, 255, (5, 16, 16, 3)).astype(np.uint8))


def drawn(symmetry, rotation=0.0, images=IMAGES, number=40):
    return [augment(images, symmetry, rotation, torch.Generator().manual_seed(seed))[0] for seed in range(number)]


def group(mirrored):
    """All quarter turns of the images, mirrored or not."""
    turned = [torch.rot90(IMAGES, k, dims=(1, 2)) for k in range(4)]
    return turned + [images.flip(2) for images in turned] if mirrored else turned


def test_a_scene_without_symmetry_is_left_alone():
    assert all(torch.equal(images, IMAGES) for images in drawn(Symmetry.NONE, rotation=10.0))


@pytest.mark.parametrize(("symmetry", "mirrored"), [(Symmetry.ROTATIONS, False), (Symmetry.ROTATIONS_AND_MIRROR, True)])
def test_exactly_the_elements_of_the_symmetry_group_are_drawn(symmetry, mirrored):
    members = group(mirrored)
    seen = {next(k for k, member in enumerate(members) if torch.equal(images, member)) for images in drawn(symmetry)}
    assert seen == set(
        range(len(members))
    )  # 40 draws miss one of 8 with probability below 8 (7/8)^40 = .04; fixed seeds


@pytest.mark.parametrize("rotation", [0.0, 10.0, 40.0])
def test_what_an_image_shows_turns_by_the_angle_that_is_said_of_it(rotation):
    """From y, along columns, to z, along rows, as an object does that is turned about the approach axis."""
    spot = np.zeros((400, 33, 33), np.uint8)
    spot[:, 14:19, 26:31] = 250  # twelve pixels right of the centre
    for seed in range(5):
        chance = torch.Generator().manual_seed(seed)
        shown, angles = augment(torch.from_numpy(spot), Symmetry.ROTATIONS, rotation, chance)
        weights = shown.double().numpy()
        z, y = np.einsum("nzy,kzy->kn", weights, np.mgrid[:33, :33] - 16.0) / weights.sum(axis=(1, 2))
        error = np.exp(1j * (np.arctan2(z, y) - angles.double().numpy()))
        assert np.rad2deg(np.abs(np.angle(error))).max() < 0.5
        small = np.rad2deg(np.angle(np.exp(4j * angles.double().numpy()))) / 4  # beyond a quarter turn
        if rotation:
            assert stats.kstest(small, stats.uniform(-rotation, 2 * rotation).cdf).pvalue > 1e-4
        else:
            assert np.abs(small).max() < 1e-4
