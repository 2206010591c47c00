"""The shipped sensor does its job, and nothing that is not one of our checkpoints is accepted."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import save_file
from scipy.stats import binom

from activetouch import SCENES, Scene, TactileSensor, TouchWorld
from activetouch.errors import LabelMismatch
from activetouch.perception.backbones import BACKBONES
from activetouch.perception.classifier import ClassifierCard, TouchClassifier, TouchNetwork
from activetouch.world import CLASSIFIER_FILE, MODELS, OBSERVATION_FILE, touch_many
from belief.errors import CorruptFile, UnknownName

pytestmark = pytest.mark.torch
SHIPPED = MODELS / "gel" / CLASSIFIER_FILE


def card(backbone="cnn", input_size=32, channels=1):
    return ClassifierCard(backbone, input_size, ("bar", "disc"), ("p",), channels)


@pytest.fixture(scope="module")
def sensor():
    return TactileSensor.shipped("gel")


@pytest.mark.mujoco
def test_the_shipped_classifier_reads_fresh_objects(sensor):
    # 400 touches of 400 objects nobody has seen, dynamic presses. At the .95 the product promises, fewer than 366
    # right has probability below 1e-3.
    right = 0
    for number in range(400):
        rng = np.random.default_rng([2026, number])
        world = TouchWorld.sample(sensor, (number % 4,), rng)
        right += int(world.touch(number % 6, rng).logits.argmax() == number % 4)
    assert right >= 366


@pytest.mark.mujoco
@pytest.mark.parametrize("name", [name for name in SCENES if name != "gel"])
def test_every_named_scene_has_a_sensor_that_reads_fresh_objects_of_it(name):
    sensor = TactileSensor.shipped(name)
    evaluation = json.loads((MODELS / name / "evaluation.json").read_text())
    num_shapes = len(sensor.scene.shapes)
    images, poses, truth = [], [], []
    for number in range(96):
        rng = np.random.default_rng([2026, number])
        world = TouchWorld.sample(sensor, (number % num_shapes,), rng)
        images.append(world.press(number % 6, rng)[0])
        poses.append(number % 6)
        truth.append(number % num_shapes)
    right = sum(
        int(touch.logits.argmax() == k) for touch, k in zip(sensor.read(np.stack(images), poses), truth, strict=True)
    )
    # At the accuracy that was measured on thousands, fewer has probability below 1e-4.
    assert right >= binom.ppf(1e-4, 96, evaluation["accuracy"])


@pytest.mark.mujoco
def test_touching_together_gives_what_touching_alone_gives(sensor):
    class Request:
        def __init__(self, number):
            self.world = TouchWorld.sample(sensor, (number,), np.random.default_rng(number))
            self.pose, self.rng = number, np.random.default_rng([9, number])

    together, _ = touch_many(sensor, [Request(number) for number in range(4)])
    for number, touch in enumerate(together):
        request = Request(number)
        alone = request.world.touch(request.pose, request.rng)
        np.testing.assert_allclose(touch.logits, alone.logits, atol=1e-3)
        assert touch.pose == alone.pose == number


@pytest.mark.mujoco
def test_the_model_claims_what_it_delivers_on_fresh_objects(sensor):
    # After six touches the fused posterior of the true shape is at least .5 for nearly every object.
    from belief import Belief, BeliefTracker

    for number in range(12):
        rng = np.random.default_rng([77, number])
        world = TouchWorld.sample(sensor, (number % 4,), rng)
        tracker = BeliefTracker(Belief.uniform(sensor.scene.shape_labels), sensor.model)
        for pose in range(6):
            tracker.update(world.touch(pose, rng))
        assert tracker.belief.probs[number % 4] > 0.9


def test_saving_and_loading_keeps_the_readings(sensor, tmp_path):
    images = np.random.default_rng(0).integers(0, 255, (3, 128, 128)).astype(np.uint8)
    sensor.classifier.save(tmp_path / "copy.safetensors")
    copy = TouchClassifier.load(tmp_path / "copy.safetensors")
    assert copy.card == sensor.classifier.card
    np.testing.assert_array_equal(copy.read(images)[0], sensor.classifier.read(images)[0])


def test_the_same_classifier_is_the_same_file(sensor, tmp_path):
    for number in range(4):
        sensor.classifier.save(tmp_path / f"{number}.safetensors")
    assert len({path.read_bytes() for path in tmp_path.iterdir()}) == 1


def test_a_truncated_checkpoint_is_a_clear_error(tmp_path):
    path = tmp_path / "half.safetensors"
    path.write_bytes(SHIPPED.read_bytes()[:100_000])
    with pytest.raises(CorruptFile, match="truncated"):
        TouchClassifier.load(path)


def test_a_foreign_checkpoint_is_a_clear_error(tmp_path):
    save_file({"weight": np.zeros(3, np.float32)}, tmp_path / "foreign.safetensors")
    with pytest.raises(CorruptFile, match="is no activetouch-classifier-3 checkpoint"):
        TouchClassifier.load(tmp_path / "foreign.safetensors")


def rewritten(path, change):
    """A copy of the shipped checkpoint with a change to its card and tensors, but not to its checksum."""
    with safe_open(SHIPPED, framework="np") as file:
        ((name, header),) = file.metadata().items()
        tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    header = json.loads(header)
    fields = json.loads(header["card"])
    change(fields, tensors)
    save_file(tensors, path, metadata={name: json.dumps({**header, "card": json.dumps(fields)})})
    return path


def swap_two_labels(fields, tensors):
    fields["shape_labels"][:2] = fields["shape_labels"][1::-1]


def touch_one_weight(fields, tensors):
    tensors["head.bias"][0] += 1.0


@pytest.mark.parametrize("change", [swap_two_labels, touch_one_weight])
def test_a_checkpoint_that_was_tampered_with_is_a_clear_error(change, tmp_path):
    with pytest.raises(CorruptFile, match="changed after it was written"):
        TouchClassifier.load(rewritten(tmp_path / "tampered.safetensors", change))


def test_a_checkpoint_whose_tensors_do_not_fit_its_card_is_a_clear_error(tmp_path):
    wide = TouchClassifier(card(), TouchNetwork(card()))
    wide.card = replace(wide.card, backbone="atto")
    wide.save(tmp_path / "misfit.safetensors")
    with pytest.raises(CorruptFile, match="does not describe a classifier"):
        TouchClassifier.load(tmp_path / "misfit.safetensors")


def test_weights_that_diverged_are_not_written(tmp_path):
    network = TouchNetwork(card())
    torch.nn.init.constant_(network.head.bias, 1e6)
    with pytest.raises(ValueError, match=r"head\.bias are not finite in half precision"):
        TouchClassifier(card(), network).save(tmp_path / "diverged.safetensors")
    assert not list(tmp_path.iterdir())


def test_loading_a_checkpoint_unpickles_nothing(monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("something was unpickled")

    monkeypatch.setattr("pickle.load", refuse)
    monkeypatch.setattr("pickle.loads", refuse)
    monkeypatch.setattr("torch.load", refuse)
    TouchClassifier.load(SHIPPED)


def test_a_scene_with_other_shapes_names_both_lists():
    shapes = {name: shape for name, shape in Scene().shapes.items() if name != "cone"}
    with pytest.raises(LabelMismatch, match=r"'cone'\], the scene has \['sphere', 'cube', 'cylinder'\]"):
        TactileSensor.shipped("gel", Scene(shapes=shapes))


def test_a_damaged_observation_model_is_a_clear_error(tmp_path):
    (tmp_path / OBSERVATION_FILE).write_text("{}")
    with pytest.raises(CorruptFile, match="no observation model"):
        TactileSensor.load(tmp_path, Scene())


def test_an_observation_model_of_other_shapes_is_refused(sensor):
    from belief.synthetic import random_model

    with pytest.raises(LabelMismatch, match="the observation model is about"):
        TactileSensor(sensor.scene, sensor.classifier, random_model(np.random.default_rng(0)))


def test_an_input_size_that_does_not_fit_the_image_is_refused():
    with pytest.raises(ValueError, match="is no multiple of the images' 128 pixels"):
        TouchNetwork(card(input_size=48))(torch.zeros(1, 128, 128))


def test_an_unknown_sensor_suggests_the_nearest():
    with pytest.raises(UnknownName, match="Did you mean 'gel'"):
        TactileSensor.shipped("jel")


@pytest.mark.parametrize("images", [np.zeros((128, 128), np.uint8), np.zeros((1, 128, 128))])
def test_what_is_no_stack_of_images_is_refused(sensor, images):
    with pytest.raises(ValueError, match="images must be uint8"):
        sensor.classifier.read(images)


def test_no_images_are_refused(sensor):
    with pytest.raises(ValueError, match="empty"):
        sensor.classifier.read(np.zeros((0, 128, 128), np.uint8))


@pytest.mark.parametrize(("shape", "channels"), [((4, 4), 1), ((32, 32), 1), ((128, 128), 1), ((64, 64, 3), 3)])
def test_coarse_fine_and_coloured_images_are_read(shape, channels):
    network = TouchNetwork(card(channels=channels)).eval()
    logits, features = network(torch.zeros((2, *shape), dtype=torch.uint8))
    assert logits.shape == (2, 2)
    assert features.shape == (2, BACKBONES["cnn"].num_features)
    with pytest.raises(ValueError, match=f"reads images of {channels} channels"):
        network(torch.zeros((2, 32, 32, 4 - channels), dtype=torch.uint8))


@pytest.mark.parametrize("name", BACKBONES)
def test_every_backbone_gives_logits_features_and_labels_in_one_pass(name):
    images = np.random.default_rng(0).integers(0, 255, (3, 64, 64)).astype(np.uint8)
    reading = TouchClassifier(card(name), TouchNetwork(card(name))).read(images)
    assert reading.logits.shape == (3, 2)
    assert reading.features.shape == (3, BACKBONES[name].num_features)
    assert reading.labels.tolist() == reading.logits.argmax(axis=1).tolist()
    assert np.isfinite(reading.logits).all()


def test_tiny_has_the_papers_768_features():
    assert BACKBONES["tiny"].num_features == 768


def test_bfloat16_reads_nearly_the_same_and_leaves_the_original_alone(sensor):
    images = np.stack([sensor.scene.press(sensor.scene.sample_object(k, rng), 0, rng)[1] for k, rng in
                       enumerate(np.random.default_rng(3).spawn(4))])  # fmt: skip
    before = sensor.classifier.read(images)
    half = sensor.classifier.to_bfloat16().read(images)
    # bfloat16 has 8 bits of mantissa: a relative 2^-8 per operation, some tens of operations deep.
    np.testing.assert_allclose(half.logits, before.logits, atol=0.1 * np.abs(before.logits).max())
    assert half.labels.tolist() == before.labels.tolist() == [0, 1, 2, 3]
    np.testing.assert_array_equal(sensor.classifier.read(images).logits, before.logits)
