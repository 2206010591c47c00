import copy
import pickle

import numpy as np
import pytest

from activetouch import TactileSensor, TouchWorld
from belief import Belief, BeliefTracker, Touch


@pytest.fixture(scope="module")
def sensor():
    return TactileSensor.shipped("coarse")


@pytest.fixture
def felt(sensor):
    world = TouchWorld.sample(sensor, ["cone"], np.random.default_rng(0))
    image, _ = world.press("front", np.random.default_rng(1))
    return image, sensor.read(image[None], ["front"])[0]


def test_logits_are_those_of_the_reader_and_read_only(sensor, felt):
    image, touch = felt
    np.testing.assert_allclose(touch.logits, sensor.reader.read(image[None]).logits[0], rtol=1e-5, atol=1e-5)
    assert touch.logits is touch.logits
    assert not touch.logits.flags.writeable
    assert not touch.features.flags.writeable
    assert touch.num_shapes == touch.logits.size == len(sensor.scene.shape_labels)


def test_a_belief_about_one_body_asks_for_no_logits(sensor, felt):
    _, touch = felt
    tracker = BeliefTracker(Belief.uniform(sensor.scene.shape_labels), sensor.model)
    found = tracker.update(touch)
    assert "logits" not in vars(touch)
    plain = BeliefTracker(Belief.uniform(sensor.scene.shape_labels), sensor.model)
    assert plain.update(Touch(touch.pose, touch.logits, touch.features)).log_probs.tolist() == found.log_probs.tolist()


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy, lambda touch: pickle.loads(pickle.dumps(touch))])
def test_a_copy_is_a_plain_touch(felt, copied):
    _, touch = felt
    found = copied(touch)
    assert type(found) is Touch
    assert (found.pose, found.logits.tolist()) == (touch.pose, touch.logits.tolist())
    assert found.features.tolist() == touch.features.tolist()


def test_other_attributes_do_not_exist(felt):
    with pytest.raises(AttributeError, match="probs"):
        _ = felt[1].probs
    assert repr(felt[1]).startswith("Touch(pose 0, 4 logits [")
