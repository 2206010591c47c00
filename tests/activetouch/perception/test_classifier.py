"""The network in torch reads what it should."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from activetouch.errors import TrainingDiverged
from activetouch.perception.backbones import BACKBONES
from activetouch.perception.card import ClassifierCard
from activetouch.perception.classifier import TouchClassifier, TouchNetwork
from activetouch.perception.export import half_weights

pytestmark = pytest.mark.torch
IMAGES = np.random.default_rng(0).integers(0, 255, (3, 64, 64)).astype(np.uint8)


def card(backbone="cnn", input_size=32, channels=1):
    return ClassifierCard(backbone, input_size, ("bar", "disc"), ("p",), channels)


@pytest.mark.parametrize("edge", [8, 16, 64])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_backbone_sees_mean_or_repeated_pixels_in_standard_deviations_from_the_mean(edge, channels):
    shape = (2, edge, edge, channels)
    images = np.random.default_rng(1).integers(0, 255, shape).astype(np.uint8)
    network = TouchNetwork(replace(card(input_size=16, channels=channels), pixel_mean=0.2, pixel_std=0.05))
    seen = []
    network.backbone.register_forward_pre_hook(lambda module, inputs: seen.append(inputs[0]))
    network(torch.from_numpy(images if channels == 3 else images[..., 0]))
    if edge > 16:
        wanted = images.reshape(2, 16, edge // 16, 16, edge // 16, channels).mean(axis=(2, 4))
    else:
        wanted = images.repeat(16 // edge, axis=1).repeat(16 // edge, axis=2)
    found = seen[0].permute(0, 2, 3, 1).numpy()
    np.testing.assert_allclose(found, (wanted / 255.0 - 0.2) / 0.05, atol=1e-5)


def test_weights_that_diverged_are_refused():
    network = TouchNetwork(card())
    torch.nn.init.constant_(network.head.bias, 1e6)
    with pytest.raises(TrainingDiverged, match=r"head\.bias are not finite in half precision"):
        half_weights(network)


@pytest.mark.parametrize("name", BACKBONES)
def test_every_backbone_gives_logits_features_and_labels_in_one_pass(name):
    reading = TouchClassifier(card(name), TouchNetwork(card(name))).read(IMAGES)
    assert reading.logits.shape == (3, 2)
    assert reading.features.shape == (3, BACKBONES[name].num_features)
    assert reading.labels.tolist() == reading.logits.argmax(axis=1).tolist()
    assert np.isfinite(reading.logits).all()
