"""Published weights are used or refused with a reason."""

import pytest
import torch

from activetouch.errors import MissingWeights
from activetouch.perception.backbones import ConvNeXt

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


def test_a_missing_folder_is_never_taken_for_a_name_on_the_hub(tmp_path):
    with pytest.raises(MissingWeights, match="there is no folder"):
        SMALL.build_pretrained(tmp_path / "nowhere", 3)


def test_a_damaged_file_of_weights_is_refused(published):
    folder, _ = published
    (folder / "model.safetensors").write_bytes(b"nothing")
    with pytest.raises(MissingWeights, match="no usable ConvNeXt weights in this folder"):
        SMALL.build_pretrained(folder, 3)
