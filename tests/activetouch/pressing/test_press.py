"""Real presses in MuJoCo: every shape in every pose, misses, extremes."""

import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from activetouch import POSES, SHAPES, Dynamic, Quasistatic, Scene
from activetouch.errors import UnstablePress
from activetouch.poses import Placement, multiply, random_orientation
from activetouch.pressing.contact import Pad, Phase, first_touch
from activetouch.pressing.dynamic import GuardedMove
from activetouch.pressing.rig import LARGEST_SCALE, Rig, shared_rig
from activetouch.shapes import EXTENDED_SHAPES

pytestmark = pytest.mark.mujoco
PAD = Pad()
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("name", list(EXTENDED_SHAPES))
def test_every_shape_in_every_pose_is_pressed_with_about_the_stop_force(name, rng):
    press = Dynamic()
    for pose, target_force in zip(POSES.values(), (1.5, 3.0) * 3, strict=True):
        orientation = multiply(pose, random_orientation(rng))
        force = press.press(PAD, Placement(EXTENDED_SHAPES[name], 1.0, orientation), target_force).force
        assert force == pytest.approx(target_force, rel=0.1)


def test_a_press_does_not_remember_the_one_before(rng):
    press = Dynamic()
    orientations = [random_orientation(rng) for _ in range(3)]

    def forces(order):
        return {
            i: press.press(PAD, Placement(SHAPES["cone"], 0.9 + 0.1 * i, orientations[i]), 2.0).force for i in order
        }

    assert forces([0, 1, 2]) == forces([2, 1, 0]) == forces([0, 1, 2])


@pytest.mark.parametrize("name", list(EXTENDED_SHAPES))
def test_resizing_in_place_gives_the_force_of_a_model_compiled_at_that_size(name, rng):
    placement, forces = Placement(EXTENDED_SHAPES[name], 1.1, random_orientation(rng)), []
    touching = first_touch(PAD, placement)[1]
    for largest_scale in (LARGEST_SCALE, 1.1):
        rig = Rig(PAD, placement.shape.geom, 0.002, largest_scale=largest_scale)
        rig.place(touching + 0.001, placement)
        forces.append([rig.step(touching + 0.001 - 2e-5 * step, Phase.CONTACT) for step in range(150)])
    assert max(forces[0]) > 0.3
    np.testing.assert_allclose(*forces, rtol=1e-5, atol=1e-7)


def test_an_object_that_misses_the_pad_gives_no_force_and_a_blank_image():
    force = Dynamic().press(PAD, Placement(SHAPES["sphere"], 1.0, UPRIGHT, np.array([0.05, 0.0])), 2.0).force
    assert force == 0.0


@pytest.mark.parametrize("timestep", [0.0005, 0.005])
@pytest.mark.parametrize("scale", [0.05, 1.0, 2.0])
def test_the_stop_force_is_reached_at_any_timestep_and_size(timestep, scale, rng):
    for shape in SHAPES.values():
        force = Dynamic(timestep=timestep).press(PAD, Placement(shape, scale, random_orientation(rng)), 2.0).force
        assert force == pytest.approx(2.0, rel=0.1)


def test_a_simulation_that_does_not_settle_is_an_error_that_says_what_to_try():
    with pytest.raises(UnstablePress, match=r"did not settle at 2 N .* Try a smaller timestep"):
        Dynamic(admittance=5.0).press(PAD, Placement(SHAPES["cube"], 1.0, UPRIGHT), 2.0)


def test_a_force_the_guide_cannot_reach_is_an_error_and_not_a_miss():
    with pytest.raises(UnstablePress, match="did not settle at 300 N"):
        Dynamic().press(PAD, Placement(SHAPES["sphere"], 1.0, UPRIGHT), 300.0)


@pytest.mark.parametrize("kind", [Dynamic, GuardedMove])
@pytest.mark.parametrize("speed", [0.0, -0.1, np.nan, np.inf])
def test_a_press_that_would_never_arrive_is_refused(kind, speed):
    with pytest.raises(ValueError, match="speed"):
        GuardedMove(speed=speed)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Dynamic(timestep=0.02, speed=1.0), "pass through the pad"),
        (lambda: Dynamic(timestep=0.0), "timestep"),
        (lambda: Dynamic(timestep=np.nan), "timestep"),
        (lambda: GuardedMove(pause=0.0), "pause"),
    ],
)
def test_a_press_that_cannot_be_simulated_is_refused(make, told):
    with pytest.raises(ValueError, match=told):
        make()


@pytest.mark.parametrize("press", [Dynamic(), Quasistatic()], ids=["dynamic", "quasistatic"])
def test_the_same_seed_gives_the_same_touch_bit_for_bit(press):
    def touch():
        rng = np.random.default_rng(5)
        scene = Scene(press_model=press)
        contact, image, *_ = scene.press(scene.sample_object(2, rng), 4, rng)
        return contact.force, image.tobytes()

    assert touch() == touch()


def test_both_fidelities_leave_nearly_the_same_image(rng):
    correlations = []
    for number in range(20):
        images = []
        for press in (Dynamic(), Quasistatic()):
            scene = Scene(press_model=press)
            stream = np.random.default_rng(number)
            images.append(scene.press(scene.sample_object(number % 4, stream), number % 6, stream)[1].ravel())
        correlations.append(np.corrcoef(*images)[0, 1])
    # They differ in the controller's overshoot alone; 2 % noise is the same in both.
    assert np.median(correlations) > 0.98
    assert min(correlations) > 0.85


@pytest.mark.parametrize(
    "pad",
    [
        Pad(contact_time=0.001),
        Pad(damping_ratio=0.02),
        Pad(contact_time=0.2),
        Pad(contact_time=0.004, damping_ratio=0.0),
    ],
)
@pytest.mark.parametrize("press", [Dynamic(), GuardedMove()], ids=["dynamic", "guarded_move"])
def test_stiff_and_bouncy_pads_give_a_physical_press_or_say_they_cannot(pad, press, rng):
    for shape in SHAPES.values():
        try:
            contact = press.press(pad, Placement(shape, 1.0, random_orientation(rng)), 2.0)
        except UnstablePress:
            continue
        assert 0.0 <= contact.force < 100.0
        assert np.isfinite(contact.indentation).all()


def test_friction_and_stiffness_are_those_of_the_placement():
    soft, stiff = (
        Quasistatic().press(PAD, Placement(SHAPES["sphere"], 1.0, UPRIGHT, stiffness=k), 2.0) for k in (0.5, 2.0)
    )
    assert soft.depth > stiff.depth
    for contact in (soft, stiff):
        assert contact.pressure.sum() * PAD.taxel_area == pytest.approx(2.0)
    rig = shared_rig(PAD, SHAPES["sphere"], 0.002, False)
    rig.place(0.05, Placement(SHAPES["sphere"], 1.0, UPRIGHT, friction=0.3))
    assert rig.model.pair_friction[0, 0] == 0.3


@pytest.mark.parametrize("speed", [0.3, 0.5])
def test_a_guarded_move_that_is_too_fast_for_its_threshold_says_what_works(speed):
    placement = Placement(SHAPES["cube"], 1.0, UPRIGHT)
    with pytest.raises(UnstablePress, match=rf"threshold is 2 N, .* holds .* N, .* {speed} m/s .* speed of") as error:
        GuardedMove(speed=speed).press(PAD, placement, 2.0)
    suggested = float(re.search(r"speed of ([0-9.e-]+) m/s", str(error.value)).group(1))
    assert GuardedMove(speed=suggested).press(PAD, placement, 2.0).force <= 3.0


@pytest.mark.parametrize("speed", [0.1, 0.5])
def test_a_controlled_press_is_not_carried_beyond_its_force_at_any_speed(speed, rng):
    for target_force in (0.2, 2.0, 5.0):
        for shape in SHAPES.values():
            contact = Dynamic(speed=speed).press(PAD, Placement(shape, 1.0, random_orientation(rng)), target_force)
            assert contact.force <= 1.101 * target_force


@pytest.mark.parametrize("press", [Dynamic(), GuardedMove()])
def test_threads_press_as_one_thread_does(press, rng):
    """Rigs are shared: two presses at a time mixed their forces, or ended the process."""
    force = 2.0 if isinstance(press, Dynamic) else 0.5
    placements = [Placement(SHAPES["cone"], 1.0, random_orientation(rng)) for _ in range(24)]
    expected = [press.press(PAD, placement, force).force for placement in placements]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda placement: press.press(PAD, placement, force).force, placements))
    assert found == expected
