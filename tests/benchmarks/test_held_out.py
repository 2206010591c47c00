import numpy as np
import pytest

from activetouch.named_scenes import SCENES
from activetouch.rendering import DeadTaxels, Gain, Noise
from benchmarks.held_out import Stream, held_out_touch, split_at_noise

pytestmark = pytest.mark.mujoco


@pytest.mark.parametrize("name", list(SCENES))
def test_a_held_out_touch_is_a_press_of_the_scene_to_the_bit(name):
    scene = SCENES[name].scene
    touch = held_out_touch(scene, 0, Stream.TEST, 5)
    rng = np.random.default_rng([0, Stream.TEST, 5])
    contact, image, *_ = scene.press(scene.sample_object(touch.shape, rng), touch.pose, rng)
    assert touch.contact.force == contact.force
    np.testing.assert_array_equal(touch.reading, image)


def test_streams_touch_other_objects():
    scene = SCENES["coarse"].scene
    forces = {held_out_touch(scene, 0, stream, 4).contact.force for stream in Stream}
    assert len(forces) == len(Stream)


def test_shapes_and_poses_take_turns():
    scene = SCENES["coarse"].scene
    seen = {(touch.shape, touch.pose) for touch in (held_out_touch(scene, 0, Stream.TEST, n) for n in range(24))}
    assert len(seen) == 24


def test_faults_are_split_at_the_noise():
    gain, noise, dead = Gain(0.1), Noise(0.1), DeadTaxels(0.1)
    assert split_at_noise((gain, noise, dead)) == ((gain,), (noise, dead))
    assert split_at_noise((gain,)) == ((gain,), ())
