"""Published weights are used or refused with a reason."""

import numpy as np
import pytest
import torch

from activetouch.errors import MissingWeights
from activetouch.perception.backbones import ConvNeXt
from activetouch.perception.convnext import ConvNeXtFeatures

pytestmark = pytest.mark.torch
SMALL = ConvNeXt((1, 1, 1, 1), (8, 8, 16, 16))


@pytest.fixture
def published(tmp_path):
    """A folder as ``transformers`` writes it, with random weights in place of ImageNet's."""
    from transformers import ConvNextConfig, ConvNextModel

    torch.manual_seed(1)
    model = ConvNextModel(ConvNextConfig(num_channels=3, depths=[1, 1, 1, 1], hidden_sizes=[8, 8, 16, 16]))
    model.save_pretrained(tmp_path / "published")
    return tmp_path / "published", model.eval()


def test_published_weights_give_the_published_features(published):
    folder, model = published
    images = torch.randn(2, 3, 32, 32)
    with torch.no_grad():
        torch.testing.assert_close(
            SMALL.build_pretrained(folder, 3).eval()(images), model(images).pooler_output, rtol=1e-4, atol=1e-5
        )


def test_a_grey_image_is_read_as_an_image_of_three_equal_colours(published):
    folder, model = published
    grey = torch.randn(2, 1, 32, 32)
    with torch.no_grad():
        torch.testing.assert_close(
            SMALL.build_pretrained(str(folder), 1).eval()(grey),
            model(grey.expand(-1, 3, -1, -1)).pooler_output,
            rtol=1e-4,
            atol=1e-5,
        )


def test_weights_of_another_network_are_refused(published):
    with pytest.raises(MissingWeights, match=r"depths and widths \(\(1, 1, 1, 1\)"):
        ConvNeXt((1, 1, 2, 1), (8, 8, 16, 16)).build_pretrained(published[0], 3)


def test_a_missing_folder_is_never_taken_for_a_name_on_the_hub(tmp_path):
    with pytest.raises(MissingWeights, match="there is no folder"):
        SMALL.build_pretrained(tmp_path / "nowhere", 3)


def test_a_folder_without_weights_says_what_belongs_there(tmp_path):
    with pytest.raises(MissingWeights, match=r"config\.json and model\.safetensors"):
        SMALL.build_pretrained(str(tmp_path), 3)


def test_a_damaged_file_of_weights_is_refused(published):
    folder, _ = published
    (folder / "model.safetensors").write_bytes(b"nothing")
    with pytest.raises(MissingWeights, match="no usable ConvNeXt weights in this folder"):
        SMALL.build_pretrained(folder, 3)


def test_a_name_that_the_hub_does_not_give_says_what_to_do_without_it():
    with pytest.raises(MissingWeights, match="as far as this machine can reach it"):
        SMALL.build_pretrained("facebook/convnext-tiny-224", 3)  # tests never go online


def test_features_do_not_depend_on_the_batch():
    torch.manual_seed(0)
    network = ConvNeXtFeatures((1, 1, 1, 1), (8, 8, 16, 16), 1).eval()
    images = torch.randn(4, 1, 32, 32)
    with torch.no_grad():
        alone = torch.cat([network(images[k : k + 1]) for k in range(4)])
        np.testing.assert_allclose(network(images).numpy(), alone.numpy(), atol=1e-5)
