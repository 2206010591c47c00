"""Real presses in MuJoCo: every shape in every pose, misses, extremes."""

import pickle

import numpy as np
import pytest

from activetouch import POSES, SHAPES, Dynamic, Quasistatic, Scene
from activetouch.pad import Pad
from activetouch.placement import Placement
from activetouch.poses import multiply, random_orientation
from activetouch.press import UnstablePress

pytestmark = pytest.mark.mujoco
PAD = Pad()
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("name", list(SHAPES))
def test_every_shape_in_every_pose_is_pressed_with_about_the_stop_force(name, rng):
    press = Dynamic()
    for pose in POSES.values():
        for target_force in (1.5, 3.0):
            orientation = multiply(pose, random_orientation(rng))
            force = press.force(PAD, Placement(SHAPES[name], 1.0, orientation), target_force)
            assert force == pytest.approx(target_force, rel=0.1)


def test_a_press_does_not_remember_the_one_before(rng):
    press = Dynamic()
    orientations = [random_orientation(rng) for _ in range(3)]

    def forces(order):
        return {i: press.force(PAD, Placement(SHAPES["cone"], 0.9 + 0.1 * i, orientations[i]), 2.0) for i in order}

    assert forces([0, 1, 2]) == forces([2, 1, 0]) == forces([0, 1, 2])


@pytest.mark.parametrize("name", list(SHAPES))
def test_resizing_in_place_gives_the_touch_of_a_model_compiled_at_that_size(name, rng, monkeypatch):
    orientation = random_orientation(rng)
    in_place = Dynamic().force(PAD, Placement(SHAPES[name], 1.1, orientation), 2.0)
    monkeypatch.setattr("activetouch.rig._LARGEST_SCALE", 1.1)
    compiled = Dynamic().force(PAD, Placement(SHAPES[name], 1.1, orientation), 2.0)
    assert in_place == pytest.approx(compiled, rel=1e-6)


def test_an_object_that_misses_the_pad_gives_no_force_and_a_blank_image():
    force = Dynamic().force(PAD, Placement(SHAPES["sphere"], 1.0, UPRIGHT, np.array([0.05, 0.0])), 2.0)
    assert force == 0.0


@pytest.mark.parametrize("timestep", [0.0005, 0.001, 0.005])
@pytest.mark.parametrize("scale", [0.05, 1.0, 2.0])
def test_the_stop_force_is_reached_at_any_timestep_and_size(timestep, scale, rng):
    for shape in SHAPES.values():
        force = Dynamic(timestep=timestep).force(PAD, Placement(shape, scale, random_orientation(rng)), 2.0)
        assert force == pytest.approx(2.0, rel=0.1)


def test_a_simulation_that_does_not_settle_is_an_error_that_says_what_to_try():
    with pytest.raises(UnstablePress, match=r"did not settle at 2 N .* Try a smaller timestep"):
        Dynamic(admittance=5.0).force(PAD, Placement(SHAPES["cube"], 1.0, UPRIGHT), 2.0)


def test_an_approach_that_could_jump_through_the_pad_is_refused():
    with pytest.raises(ValueError, match="pass through the pad"):
        Dynamic(speed=20.0)


def test_a_force_the_guide_cannot_reach_is_an_error_and_not_a_miss():
    with pytest.raises(UnstablePress, match="did not settle at 300 N"):
        Dynamic().force(PAD, Placement(SHAPES["sphere"], 1.0, UPRIGHT), 300.0)


def test_a_pause_of_no_steps_is_refused():
    with pytest.raises(ValueError, match="pause"):
        Dynamic(pause=0.0)


def test_an_absurd_size_is_refused():
    with pytest.raises(ValueError, match="scale must be in"):
        Dynamic().force(PAD, Placement(SHAPES["cube"], 50.0, UPRIGHT), 2.0)


def test_a_dynamic_press_survives_pickling_without_its_models(rng):
    press = Dynamic(speed=0.05)
    orientation = random_orientation(rng)
    before = press.force(PAD, Placement(SHAPES["cylinder"], 1.0, orientation), 2.0)
    copy = pickle.loads(pickle.dumps(press))
    assert copy == press
    assert copy.force(PAD, Placement(SHAPES["cylinder"], 1.0, orientation), 2.0) == before


@pytest.mark.parametrize("press", [Dynamic(), Quasistatic()], ids=["dynamic", "quasistatic"])
def test_the_same_seed_gives_the_same_touch_bit_for_bit(press):
    def touch():
        rng = np.random.default_rng(5)
        scene = Scene(press_model=press)
        contact, image = scene.press(scene.sample_object(2, rng), 4, rng)
        return contact.force, image.tobytes()

    assert touch() == touch()


def test_both_fidelities_leave_nearly_the_same_image(rng):
    correlations = []
    for number in range(40):
        images = []
        for press in (Dynamic(), Quasistatic()):
            scene = Scene(press_model=press)
            stream = np.random.default_rng(number)
            images.append(scene.press(scene.sample_object(number % 4, stream), number % 6, stream)[1].ravel())
        correlations.append(np.corrcoef(*images)[0, 1])
    # They differ in the controller's overshoot alone; 2 % noise is the same in both.
    assert np.median(correlations) > 0.98
    assert min(correlations) > 0.85
