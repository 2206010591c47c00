"""A grid of means knows where on the pad a contact is; the mean over the image does not."""

import numpy as np
import pytest
import torch

from activetouch.perception.backbones import BACKBONES

pytestmark = pytest.mark.torch


def features(backbone, corner):
    """Of a square of 8 pixels on an image of 128, far from its edges."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = BACKBONES[backbone].build(channels=1)
    image = torch.zeros(1, 1, 128, 128)
    image[0, 0, corner : corner + 8, corner : corner + 8] = 1.0
    with torch.inference_mode():
        return network(image)[0].numpy()


@pytest.mark.parametrize(("backbone", "knows"), [("cnn", False), ("grid_cnn", True)])
def test_where_a_contact_is(backbone, knows):
    first, second = (features(backbone, corner) for corner in (48, 80))
    assert first.shape == (BACKBONES[backbone].num_features,)
    assert (np.abs(first - second).max() > 1e-3) == knows


@pytest.mark.parametrize(("size", "works"), [(16, False), (17, True), (32, True)])
def test_the_smallest_image_fills_the_grid(size, works):
    convolutions = BACKBONES["grid_cnn"].build(channels=1)[:-4]
    assert (BACKBONES["grid_cnn"].smallest_image <= size) == works
    assert (convolutions(torch.zeros(1, 1, size, size)).shape[-1] >= 2) == works
