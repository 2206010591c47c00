"""The shipped sensors do their job without torch, and nothing that is not one of our readers is accepted."""

import json
from dataclasses import replace

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file
from scipy.stats import binom

from activetouch import SCENES, Scene, TactileSensor, TouchWorld
from activetouch.perception.card import READER, read_card
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import MODELS, OBSERVATION_FILE, READER_FILE
from activetouch.world import touch_many
from belief.errors import CorruptFile
from belief.sealed_tensors import read_tensors, write_tensors

SHIPPED = MODELS / "gel" / READER_FILE
IMAGES = np.random.default_rng(0).integers(0, 255, (3, 128, 128)).astype(np.uint8)


@pytest.fixture(scope="module")
def sensor():
    return TactileSensor.shipped("gel")


@pytest.mark.mujoco
@pytest.mark.parametrize("name", SCENES)
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
    def request(number):
        world = TouchWorld.sample(sensor, (number,), np.random.default_rng(number))
        return world, number, np.random.default_rng([9, number])

    together, _ = touch_many(sensor, [request(number) for number in range(4)])
    for number, touch in enumerate(together):
        world, pose, rng = request(number)
        alone = world.touch(pose, rng)
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


def test_a_damaged_observation_model_is_a_clear_error(tmp_path):
    (tmp_path / OBSERVATION_FILE).write_text("{}")
    with pytest.raises(CorruptFile, match="no observation model"):
        TactileSensor.load(tmp_path, Scene())


@pytest.mark.parametrize("images", [np.zeros((128, 128), np.uint8), np.zeros((1, 128, 128))])
def test_what_is_no_stack_of_images_is_refused(sensor, images):
    with pytest.raises(ValueError, match="images must be uint8"):
        sensor.reader.read(images)


def test_saving_and_loading_keeps_the_readings_and_the_file(sensor, tmp_path):
    sensor.reader.save(tmp_path / "copy.safetensors")
    copy = TactileReader.load(tmp_path / "copy.safetensors")
    assert copy.card == sensor.reader.card == read_card(SHIPPED)
    np.testing.assert_array_equal(copy.read(IMAGES).logits, sensor.reader.read(IMAGES).logits)
    assert (tmp_path / "copy.safetensors").read_bytes() == SHIPPED.read_bytes()


def test_readings_are_the_same_every_time_and_alone_nearly_as_together(sensor):
    images = np.concatenate([IMAGES] * 30)
    together = sensor.reader.read(images)
    np.testing.assert_array_equal(sensor.reader.read(images).logits, together.logits)
    np.testing.assert_allclose(sensor.reader.read(images, 1).logits, together.logits, rtol=1e-5, atol=1e-4)
    assert together.labels.tolist() == together.logits.argmax(axis=1).tolist()


def test_images_of_another_size_are_averaged_down_or_repeated_up(sensor):
    small = IMAGES[:, ::4, ::4]
    repeated = small.repeat(4, axis=1).repeat(4, axis=2)
    expected = sensor.reader.read(repeated).logits
    np.testing.assert_array_equal(sensor.reader.read(small).logits, expected)
    np.testing.assert_array_equal(sensor.reader.read(repeated.repeat(2, axis=1).repeat(2, axis=2)).logits, expected)
    for shape in ((1, 96, 96), (1, 128, 128, 3), (1, 64, 96), (1, 128, 64), (1, 256, 128)):
        with pytest.raises(ValueError, match=r"takes images of shape \(128, 128\), got"):
            sensor.reader.read(np.zeros(shape, np.uint8))


def test_a_foreign_file_is_a_clear_error(tmp_path):
    save_file({"weight": np.zeros(3, np.float32)}, tmp_path / "foreign.safetensors")
    with pytest.raises(CorruptFile, match="holds another program's tensors, not activetouch-reader-1"):
        TactileReader.load(tmp_path / "foreign.safetensors")


def swap_two_labels(fields, tensors):
    fields["shape_labels"][:2] = fields["shape_labels"][1::-1]


def change_one_byte(fields, tensors):
    tensors["network"][1000] += 1


@pytest.mark.parametrize("change", [swap_two_labels, change_one_byte])
def test_a_reader_that_was_tampered_with_is_a_clear_error(change, tmp_path):
    with safe_open(SHIPPED, framework="np") as file:
        header = json.loads(file.metadata()[READER])
        tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    change(header["fields"], tensors)
    save_file(tensors, tmp_path / "tampered.safetensors", metadata={READER: json.dumps(header)})
    with pytest.raises(CorruptFile, match="changed after it was written"):
        TactileReader.load(tmp_path / "tampered.safetensors")


def cut_network(fields, tensors):
    tensors["network"] = tensors["network"][:1000]


def no_network(fields, tensors):
    del tensors["network"]


def another_shape(fields, tensors):
    fields["shape_labels"].append("torus")


def an_embedding_without_hypotheses(fields, tensors):
    fields["embedding"] = 4


def an_unknown_field(fields, tensors):
    fields["colour"] = "red"


@pytest.mark.parametrize(
    "change", [cut_network, no_network, another_shape, an_embedding_without_hypotheses, an_unknown_field]
)
def test_a_file_that_does_not_describe_a_reader_is_a_clear_error(change, tmp_path):
    tensors, fields = read_tensors(SHIPPED, READER)
    change(fields, tensors)
    write_tensors(tmp_path / "other.safetensors", tensors, fields, READER)
    with pytest.raises(CorruptFile, match=r"does not describe a (reader|classifier)"):
        TactileReader.load(tmp_path / "other.safetensors")


@pytest.mark.parametrize("name", [None, "sinusoidal"])
def test_another_network_of_hypotheses_is_refused_and_has_to_be_trained_again(name, tmp_path):
    tensors, fields = read_tensors(SHIPPED, READER)
    fields["hypothesis_network"] = name
    write_tensors(tmp_path / "other.safetensors", tensors, fields, READER)
    with pytest.raises(CorruptFile, match=rf"is {name!r}, .*train it again"):
        TactileReader.load(tmp_path / "other.safetensors")


def test_logits_may_be_left_out_and_the_belief_of_one_body_is_the_same():
    sensor = TactileSensor.shipped("coarse")
    image, _ = TouchWorld.sample(sensor, ["cone"], np.random.default_rng(0)).press("front", np.random.default_rng(1))
    [whole], [bare] = (replace(sensor, with_logits=given).read(image[None], ["front"]) for given in (True, False))
    np.testing.assert_allclose(whole.logits, sensor.reader.read(image[None]).logits[0], rtol=1e-5, atol=1e-5)
    assert (bare.logits, bare.features.tolist()) == (None, whole.features.tolist())
    found, expected = (sensor.model.start().update(touch).log_weights for touch in (bare, whole))
    np.testing.assert_array_equal(found, expected)
