"""Augmentations are symmetries: nothing else changes, and nothing is done that the scene does not allow."""

import numpy as np
import pytest
import torch

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


def test_a_small_rotation_keeps_a_disc_in_the_middle():
    y, x = np.mgrid[:64, :64] - 31.5
    disc = torch.from_numpy((200 * np.exp(-((x**2 + y**2) / 200))).astype(np.uint8))[None]
    for images in drawn(Symmetry.ROTATIONS, rotation=10.0, images=disc, number=10):
        assert (images.int() - disc.int()).abs().max() <= 2  # rounding twice, and linear interpolation


def test_a_small_rotation_turns_by_at_most_its_angle():
    spot = np.zeros((1, 65, 65), np.uint8)
    spot[0, 30:35, 58:63] = 250  # 28 pixels right of the centre
    for images in drawn(Symmetry.ROTATIONS, rotation=10.0, images=torch.from_numpy(spot), number=20):
        weight = images[0].numpy().astype(float)
        y, x = (np.mgrid[:65, :65] * weight).sum(axis=(1, 2)) / weight.sum() - 32
        angle = np.rad2deg(np.arctan2(y, x)) % 90.0
        assert min(angle, 90.0 - angle) <= 10.3
        assert abs(np.hypot(x, y) - 28.0) < 0.5


def test_grey_and_coloured_images_keep_their_shape_and_type():
    for images in (IMAGES, IMAGES[..., 0]):
        (out,) = drawn(Symmetry.ROTATIONS_AND_MIRROR, rotation=5.0, images=images, number=1)
        assert (out.shape, out.dtype) == (images.shape, torch.uint8)
