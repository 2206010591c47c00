"""Worn images: half of them, with the gain, the noise and the dead taxels that were asked for."""

import pytest
import torch

from activetouch.perception.augmentation import worn

pytestmark = pytest.mark.torch
IMAGES = torch.full((4000, 8, 8), 160, dtype=torch.uint8)


def chance():
    return torch.Generator().manual_seed(0)


@pytest.mark.parametrize("taxels", [1, 16])
def test_half_of_the_images_have_up_to_the_share_of_dead_taxels(taxels):
    shares = 1.0 - worn(IMAGES, 0.0, 0.0, 0.4, taxels, chance()).float().mean((1, 2)) / 160
    assert 0.43 < (shares > 0).float().mean() < 0.55  # by chance, some shares kill no taxel
    assert shares.mean().item() == pytest.approx(0.1, abs=0.01)
    assert 0.38 < shares.max() < 0.6


def test_gains_are_uniform_in_their_range():
    gains = worn(IMAGES, 0.25, 0.0, 0.0, 16, chance()).float().mean((1, 2)) / 160
    changed = gains[gains != 1.0]
    assert 0.45 < len(changed) / len(IMAGES) < 0.55
    assert changed.mean().item() == pytest.approx(1.0, abs=0.02)
    assert changed.std().item() == pytest.approx(0.25 / 3**0.5, abs=0.01)
    assert 0.75 <= changed.min() < changed.max() <= 1.25


def test_noise_has_up_to_the_standard_deviation():
    spreads = worn(IMAGES, 0.0, 0.02, 0.0, 1, chance()).float().std((1, 2)) / 255
    changed = spreads[spreads > 0]
    assert 0.45 < len(changed) / len(IMAGES) < 0.55
    assert changed.mean().item() == pytest.approx(0.01, abs=0.001)
    assert changed.max() < 0.03


def test_channels_of_a_pixel_share_its_taxels_and_the_originals_stay():
    images = torch.full((50, 8, 8, 3), 200, dtype=torch.uint8)
    changed = worn(images, 0.0, 0.0, 0.5, 4, chance())
    assert (changed == changed[..., :1]).all()
    assert (changed < 200).any()
    assert (images == 200).all()
