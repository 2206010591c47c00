"""An exported reader gives what its network in torch gives, and is small and reproducible."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from activetouch.distributions import Uniform, quaternions, sizes
from activetouch.perception import classifier as backbones_of_classifiers
from activetouch.perception.backbones import ConvNeXt
from activetouch.perception.card import ClassifierCard
from activetouch.perception.classifier import Hypotheses, HypothesisNetwork, TouchClassifier, TouchNetwork
from activetouch.perception.export import export_reader
from activetouch.perception.reader import HypothesisEmbedding, TactileReader
from activetouch.poses import to_matrices

pytestmark = pytest.mark.torch


SMALL = {"small convnext": ConvNeXt((1, 1, 1, 1), (8, 8, 16, 16))}  # every operation of a large one, once


@pytest.fixture(autouse=True)
def small_backbone(monkeypatch):
    monkeypatch.setattr(backbones_of_classifiers, "BACKBONES", backbones_of_classifiers.BACKBONES | SMALL)


def classifier(backbone, input_size, channels=1, num_shapes=4):
    labels = tuple(f"shape {k}" for k in range(num_shapes))
    card = ClassifierCard(backbone, input_size, labels, ("p",), channels)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = TouchNetwork(card)
    network.load_state_dict({name: value.half() for name, value in network.state_dict().items()})
    return TouchClassifier(card, network)


@pytest.mark.parametrize(
    ("backbone", "input_size", "image_shape"),
    [
        ("grid_cnn", 32, (128, 128)),
        pytest.param("small convnext", 32, (64, 64, 3), marks=pytest.mark.nightly),
    ],
)
def test_a_reader_gives_what_its_network_gives(backbone, input_size, image_shape, tmp_path, rng):
    single = classifier(backbone, input_size, 3 if len(image_shape) == 3 else 1)
    export_reader(single, image_shape).save(tmp_path / "reader.safetensors")
    reader = TactileReader.load(tmp_path / "reader.safetensors")
    images = rng.integers(0, 255, (7, *image_shape)).astype(np.uint8)
    for number in (1, 7):
        found, expected = reader.read(images[:number]), single.read(images[:number])
        np.testing.assert_allclose(found.logits, expected.logits, atol=1e-4)
        np.testing.assert_allclose(found.features, expected.features, atol=1e-4)
        np.testing.assert_array_equal(found.embeddings, found.features)
    parameters = sum(p.numel() for p in single.network.parameters())
    assert (tmp_path / "reader.safetensors").stat().st_size < 2 * parameters + 150_000  # half precision
    assert reader.card == replace(single.card, image_shape=image_shape)


def arrays(network):
    """Weight and bias of every layer."""
    return tuple((layer.weight.detach().numpy(), layer.bias.detach().numpy()) for layer in network)


def test_a_reader_with_hypotheses_averages_the_ratio_over_them(tmp_path, rng):
    number, orientations = 50, quaternions(50)
    single = classifier("cnn", 16, num_shapes=5)  # the outputs of its head are the embedding
    card = replace(single.card, shape_labels=("a", "b", "c"), embedding=5, log_size_mean=0.02, log_size_std=0.06)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        g = HypothesisNetwork(card).half().float()
    turns, scales = to_matrices(orientations).astype(np.float32), sizes(Uniform(0.9, 1.1), number).astype(np.float32)
    hypotheses = HypothesisEmbedding(card, arrays(g), turns, scales)
    reader = replace(export_reader(single, (16, 16)), hypotheses=hypotheses)
    reader = replace(reader, card=replace(card, image_shape=(16, 16)))
    reader.save(tmp_path / "reader.safetensors")
    reader = TactileReader.load(tmp_path / "reader.safetensors")

    columns = (orientations, scales)
    with torch.inference_mode():
        given = [torch.from_numpy(column).float() for column in columns]
        expected = np.stack([g(Hypotheses(torch.full((number,), k), *given)).numpy() for k in range(3)])
    found = reader.hypotheses.embed(np.full(50, 1), turns, scales)
    np.testing.assert_allclose(found, expected[1], atol=1e-5)
    images = rng.integers(0, 255, (4, 16, 16)).astype(np.uint8)
    reading = reader.read(images)
    np.testing.assert_allclose(reading.embeddings, single.read(images).logits, atol=1e-4)
    scores = np.einsum("nd,kmd->nkm", reading.embeddings.astype(float), expected.astype(float))
    np.testing.assert_allclose(reading.logits, np.log(np.exp(scores).mean(axis=2)), atol=1e-4)


def test_a_network_of_hypotheses_gives_the_same_without_torch(rng):
    card = ClassifierCard(
        "cnn", 16, ("a", "b", "c"), ("p",), embedding=7, log_size_mean=0.02, log_size_std=0.06,
    )  # fmt: skip
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = HypothesisNetwork(card)
    orientations, scales = quaternions(60), sizes(Uniform(0.9, 1.1), 60)
    shapes = rng.integers(3, size=60)
    rotations = to_matrices(orientations)
    embedding = HypothesisEmbedding(card, arrays(network), rotations.astype(np.float32), scales.astype(np.float32))
    columns = (torch.from_numpy(column).float() for column in (orientations, scales))
    expected = network(Hypotheses(torch.from_numpy(shapes), *columns)).detach().numpy()
    assert expected.std() > 0.02
    np.testing.assert_allclose(embedding.embed(shapes, rotations, scales), expected, atol=1e-5)
    first, _, _, last = embedding.layers
    narrow = (first[0][:7], first[1][:7])
    for layers in ((narrow,), (first, (last[0], last[1]), (last[0][:, :7], last[1]))):
        with pytest.raises(ValueError, match="hidden layers of one width"):
            replace(embedding, layers=layers)
    for wrong in (
        {"sizes": scales[:0], "rotations": embedding.rotations[:0]},
        {"sizes": scales[:59]},
        {"sizes": np.append(scales[:59], 0.0)},
        {"layers": ()},
        {"layers": (first, (last[0], last[1][:6]))},
    ):
        with pytest.raises(ValueError, match="hypotheses"):
            replace(embedding, **wrong)
