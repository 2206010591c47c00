"""Published weights are used, or refused with a reason."""

import pytest
import torch

from activetouch.errors import MissingWeights
from activetouch.perception.backbones import ConvNeXt

pytestmark = pytest.mark.torch
SMALL = ConvNeXt((1, 1, 1, 1), (8, 8, 16, 16))


@pytest.fixture(params=["ConvNextModel", "ConvNextForImageClassification"])
def published(request, tmp_path):
    """A folder as ``transformers`` writes it, alone or below a head of classes, with weights of no other network."""
    import transformers  # takes three seconds, which no other process of tests needs

    torch.manual_seed(1)
    config = transformers.ConvNextConfig(num_channels=3, depths=[1, 1, 1, 1], hidden_sizes=[8, 8, 16, 16])
    model = getattr(transformers, request.param)(config)
    model.save_pretrained(tmp_path / "published")
    return tmp_path / "published", getattr(model, "convnext", model).eval()


def features(folder, channels, images):
    network = SMALL.build(channels)
    assert network.load_published(str(folder)) == f"the weights in {folder}"
    with torch.no_grad():
        return network.eval()(images)


def test_published_weights_give_the_published_features_of_colour_and_of_grey(published):
    folder, model = published
    images = torch.randn(2, 3, 32, 32)
    with torch.no_grad():
        wanted = model(images).pooler_output
        grey = model(images[:, :1].expand(-1, 3, -1, -1)).pooler_output
    torch.testing.assert_close(features(folder, 3, images), wanted, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(features(folder, 1, images[:, :1]), grey, rtol=1e-4, atol=1e-4)


def test_what_is_no_such_network_is_refused_with_a_way_out(published, tmp_path):
    folder, _ = published
    with pytest.raises(MissingWeights, match=r"there is no such folder\. Give imagenet, or a folder with config\.json"):
        SMALL.build(3).load_published(str(tmp_path / "nowhere"))
    with pytest.raises(MissingWeights, match=r"it has no config\.json"):
        SMALL.build(3).load_published(str(tmp_path))
    with pytest.raises(MissingWeights, match=r"has depths, widths and patches .*\[8, 8, 16, 16\]"):
        ConvNeXt((1, 1, 1, 1), (8, 8, 16, 32)).build(3).load_published(str(folder))
    (folder / "model.safetensors").write_bytes(b"nothing")
    with pytest.raises(MissingWeights, match=r"no weights of .*published"):
        SMALL.build(3).load_published(str(folder))


def test_without_a_hub_or_a_copy_one_sentence_says_what_to_do(monkeypatch):
    def unreachable(*_, **__):
        raise OSError("We couldn't connect to 'https://huggingface.co'")

    monkeypatch.setattr("transformers.ConvNextModel.from_pretrained", unreachable)
    with pytest.raises(MissingWeights, match=r"hub cannot be reached.*no copy\)\. Download .* give --weights FOLDER"):
        SMALL.build(3).load_published("imagenet")
