import numpy as np
import pytest

from activetouch.named_scenes import SCENES
from benchmarks.held_out import Stream, held_out_touch

pytestmark = pytest.mark.mujoco


@pytest.mark.parametrize("name", list(SCENES))
def test_a_held_out_touch_is_a_press_of_the_scene_to_the_bit(name):
    scene = SCENES[name].scene
    touch = held_out_touch(scene, 0, Stream.TEST, 5)
    rng = np.random.default_rng([0, Stream.TEST, 5])
    contact, image, *_ = scene.press(scene.sample_object(touch.shape, rng), touch.pose, rng)
    assert touch.contact.force == contact.force
    np.testing.assert_array_equal(touch.reading, image)
