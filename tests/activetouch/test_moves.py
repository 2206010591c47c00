"""Objects that move between touches, in the world and in what a sensor believes of it."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from activetouch import SCENES, TactileSensor, TouchWorld
from activetouch.distributions import Constant, Uniform, quaternions
from activetouch.errors import SceneShift, WrongScene
from activetouch.orientations import Held, Inexact, Moves, Resampled
from activetouch.perception.contacts.hypotheses import cell_of
from activetouch.perception.moving import moving_model, turning_kernel, turns
from activetouch.poses import WorldObject, hamilton_product
from activetouch.pressing.contact import Quasistatic
from activetouch.scene_description import scene_fields
from activetouch.sensor_files import (
    ANY_OBJECT_FILE,
    MODELS,
    READER_FILE,
    fitted_model,
    is_farther_off,
    reader_file,
)
from belief.errors import InvalidArgument
from belief.observation_model.moving_body import MovingBodyModel
from experiments.scene_choice import SceneChoice, choice_name

WIDE = Uniform(-0.005, 0.005)
COARSE = replace(SCENES["coarse"].scene, press_model=Quasistatic())


def angles(one, other):
    """Between unit quaternions ``(..., 4)`` [rad]."""
    return 2.0 * np.arccos(np.minimum(np.abs(np.sum(one * other, axis=-1)), 1.0))


def test_moves_turn_and_shift_as_they_say():
    rng = np.random.default_rng(0)
    resting, moves = WorldObject(0, 1.0, quaternions(3)[1]), Moves(0.3, np.deg2rad(15.0), 0.005)
    found = [moves.after(resting, rng) for _ in range(3000)]
    moved = [each for each in found if each is not resting]
    assert len(moved) / len(found) == pytest.approx(0.3, abs=0.03)
    turned = angles(np.stack([each.orientation for each in moved]), resting.orientation)
    assert np.sqrt(np.mean(np.square(turned)) / 3.0) == pytest.approx(np.deg2rad(15.0), rel=0.08)
    offsets = np.stack([each.offset for each in moved])
    assert np.abs(offsets).max() <= 0.005
    np.testing.assert_allclose(offsets.std(axis=0), 0.005 / np.sqrt(3.0), rtol=0.08)
    assert moves.after(replace(resting, scale=1.1), np.random.default_rng(1)).scale == 1.1


def test_an_object_moves_between_touches_and_not_before_the_first():
    scene = replace(COARSE, moves=Moves(prob=1.0))
    world = TouchWorld.sample(SimpleNamespace(scene=scene), (0, 1), np.random.default_rng(0))
    first = world.current
    world.press(0, np.random.default_rng(0))
    assert world.current is first
    world.press(0, np.random.default_rng(0))
    assert angles(world.current.orientation, first.orientation) > 0.0
    world.advance()
    second = world.current
    assert second.offset is None
    world.press(0, np.random.default_rng(0))
    assert world.current is second
    world.reset()
    assert world.current is first


def test_where_objects_stay_the_bytes_are_the_same():
    plain, still = (
        TouchWorld.sample(SimpleNamespace(scene=scene), (0,), np.random.default_rng(0))
        for scene in (COARSE, replace(COARSE, moves=Moves(prob=0.0)))
    )
    for pose in (0, 1, 0):
        rng, used = np.random.default_rng(pose), np.random.default_rng(pose)
        image, _ = plain.press(pose, rng)
        np.testing.assert_array_equal(image, COARSE.press(plain.current, pose, used).image)
        assert rng.random() == used.random()  # nothing else was drawn
        still.press(pose, rng)
        assert still.current.orientation is not plain.current.orientation
        np.testing.assert_array_equal(still.current.orientation, plain.current.orientation)
    assert "moves" not in scene_fields(COARSE)
    assert "moves" in scene_fields(replace(COARSE, moves=Moves()))


def test_a_shifted_object_meets_the_pad_beside_the_middle_and_turns_with_its_pose():
    scene = replace(COARSE, variation=replace(COARSE.variation, offset=Uniform(0.0, 0.0)))
    obj = replace(scene.sample_object(0, np.random.default_rng(0)), offset=np.array([0.001, 0.002, 0.003]))
    found = {pose: scene.place(obj, pose, np.random.default_rng(0)).offset for pose in ("front", "z90")}
    np.testing.assert_allclose(found["front"], [0.002, 0.003], atol=1e-12)
    np.testing.assert_allclose(found["z90"], [0.001, 0.003], atol=1e-12)


def test_a_hand_that_holds_an_object_lets_none_move():
    with pytest.raises(InvalidArgument, match=r"Closing\(\)"):
        replace(COARSE.with_hand("parallel"), moves=Moves())
    with pytest.raises(InvalidArgument, match="Moves"):
        replace(COARSE, moves=0.2)


@pytest.mark.mujoco
def test_one_finger_lets_an_object_turn_only_with_a_grip():
    from activetouch.pressing.closing import Closing

    for held in (Closing(), Closing(grip=0.01, turns=False)):
        with pytest.raises(InvalidArgument, match=r"one finger by Closing\(grip=0.01\)"):
            replace(COARSE.with_hand("one_finger", held), moves=Moves())
    scene = replace(COARSE.with_hand("one_finger", Closing(grip=0.01)), moves=Moves())
    assert scene.moves == Moves()


def test_a_hand_that_lets_no_object_turn_leaves_it_as_it_lay():
    scene, rng = COARSE.with_hand("parallel"), np.random.default_rng(0)
    obj = scene.sample_object("cube", rng)
    for pose in ("front", "z45", "corner"):
        found = scene.press(obj, pose, rng)
        assert angles(found.left, obj.orientation) < 1e-6
    assert COARSE.press(obj, "front", rng).left is None


@pytest.mark.mujoco
def test_an_object_lies_as_a_grasp_leaves_it():
    from activetouch.pressing.closing import Closing

    scene = replace(COARSE.with_hand("parallel", Closing()), moves=Moves(0.3, 0.2))
    slippery = replace(scene, variation=replace(scene.variation, friction=Constant(0.3)))
    world = TouchWorld.sample(SimpleNamespace(scene=slippery), ["cone"], np.random.default_rng(3))
    first = world.current
    turned = []
    for seed in range(4):
        before = world.current
        world.press("z45", np.random.default_rng(seed))
        turned.append(angles(world.current.orientation, before.orientation))
        assert world.current.offset is None
    assert max(turned) > np.deg2rad(5.0)
    found = slippery.press(first, "z45", np.random.default_rng(1))
    rng = np.random.default_rng(1)
    in_palm, depth = slippery.place_in_palm(first, "z45", rng)
    met, hand = slippery.hand.placements(in_palm, depth), slippery.hand
    forces = (hand.forces * slippery.variation.force.sample(rng)).tolist()
    centre = np.array([depth, *in_palm.offset])
    after = slippery.press_model.close(slippery.pad, met, hand.rotations, centre, forces).met
    seen = slippery.place_in_palm(replace(first, orientation=found.left), "z45", np.random.default_rng(1))
    wanted = hand.placements(*seen)
    for one, other in zip(after, wanted, strict=True):
        assert angles(one.orientation, other.orientation) < 1e-6
    world.reset()
    assert world.current is first
    still = TouchWorld.sample(SimpleNamespace(scene=replace(slippery, moves=None)), ["cone"], np.random.default_rng(3))
    still.press("z45", np.random.default_rng(0))
    np.testing.assert_array_equal(still.current.orientation, first.orientation)


@pytest.mark.parametrize(("degrees", "number"), [(15.0, 2048), (25.0, 2048), (15.0, 4096), (5.0, 1024)])
def test_a_kernel_turns_as_far_as_a_move_from_somewhere_in_a_cell_to_somewhere_in_another(degrees, number):
    rests, cell = quaternions(number), cell_of(number)
    kernel = turning_kernel(rests, np.deg2rad(degrees))
    rows = np.random.default_rng(0).integers(number, size=40)
    weights = np.full((40, number), -np.inf)
    weights[np.arange(40), rows] = 0.0
    after = np.exp(kernel.moved(weights, 1.0))
    after /= after.sum(axis=1, keepdims=True)
    turned = angles(rests[rows][:, None], rests)
    found = np.sqrt((after * np.square(turned)).sum(axis=1).mean() / 3.0)
    assert found == pytest.approx(np.hypot(np.deg2rad(degrees), np.sqrt(2.0) * cell), rel=0.12)


def test_turns_keep_the_size_as_far_as_hypotheses_allow():
    rests, sizes = quaternions(512), np.random.default_rng(0).random(512)
    spread = []
    for kept in ([], [sizes]):
        found = turns(rests, 0.5, 0.5, np.ones(512), kept=kept)
        rows = np.repeat(np.arange(512), np.diff(found.starts))
        spread.append(np.sqrt(found.joint @ np.square(sizes[rows] - sizes[found.columns])))
    assert spread[1] < 0.16 < 0.35 < spread[0]


def test_turns_depend_on_the_angle_alone():
    rests = quaternions(64)
    turned = np.stack(hamilton_product(quaternions(7)[3], rests.T), axis=1)
    one, other = (turns(each, 0.4, 0.4, np.ones(64)) for each in (rests, turned))
    np.testing.assert_allclose(one.joint, other.joint, atol=1e-9)


@pytest.mark.torch
def test_a_sensor_expects_what_its_scene_says():
    sensor = TactileSensor.shipped("coarse")
    with warnings.catch_warnings():
        warnings.simplefilter("error", SceneShift)
        moving = TactileSensor.shipped("coarse", replace(SCENES["coarse"].scene, moves=Moves(0.2)))
    assert not isinstance(sensor.model, MovingBodyModel)
    assert moving.model.prob == 0.2
    assert moving.model.error is None
    assert moving.scene.moves == Moves(0.2)
    with pytest.warns(SceneShift, match="Inexact"):
        missed = TactileSensor.shipped("coarse", replace(SCENES["coarse"].scene, presentation=Inexact(0.35)))
    assert missed.model.kernel is None
    assert missed.model.error is not None
    assert moving.digest != sensor.digest
    assert moving_model(sensor.model, SCENES["coarse"].scene) is sensor.model


@pytest.mark.torch
def test_a_pose_error_that_cells_express_changes_no_model():
    with pytest.warns(SceneShift):
        sensor = TactileSensor.shipped("coarse", replace(SCENES["coarse"].scene, presentation=Inexact()))
    assert not isinstance(sensor.model, MovingBodyModel)


@pytest.mark.torch
def test_a_belief_that_knows_no_orientation_refuses_moves():
    with pytest.raises(WrongScene, match="only a belief about one rigid body"):
        TactileSensor.shipped("paper-independent", replace(SCENES["paper"].scene, moves=Moves()))


def test_options_of_a_scene_are_left_out_where_they_have_no_effect():
    plain, moving = SceneChoice("coarse"), SceneChoice("coarse", moves=0.2, moves_turn=10.0, moves_shift=2.0)
    assert "moves" not in plain.to_dict()
    assert plain.named.scene.moves is None
    assert moving.named.scene.moves == Moves(0.2, np.deg2rad(10.0), 0.002)
    missed = SceneChoice("coarse", pose_error=20.0, off=5.0)
    assert missed.named.scene.presentation == Inexact(np.deg2rad(20.0))
    assert missed.named.scene.variation.offset == Uniform(-0.005, 0.005)
    assert len({choice_name(each) for each in (plain, moving, missed)}) == 3
    with pytest.raises(InvalidArgument, match="tumbled"):
        _ = SceneChoice("coarse", presentation="upright", pose_error=20.0).named


@pytest.mark.torch
def test_a_sensor_is_fitted_to_presses_that_are_farther_beside_the_middle():
    coarse, keyed = (SCENES[name].scene for name in ("coarse", "keyed"))
    coarse_off, keyed_off = (replace(each, variation=replace(each.variation, offset=WIDE)) for each in (coarse, keyed))
    own = fitted_model(MODELS / "keyed").scene
    assert not is_farther_off(own, keyed)
    assert is_farther_off(own, keyed_off)
    assert not is_farther_off(None, keyed)
    assert reader_file(MODELS / "coarse", coarse).name == READER_FILE
    assert reader_file(MODELS / "coarse", coarse_off).name == ANY_OBJECT_FILE
    independent = SCENES["paper"].scene
    farthest = replace(independent, variation=replace(independent.variation, offset=WIDE))
    with pytest.warns(SceneShift, match="offset"):
        assert TactileSensor.shipped("paper-independent", farthest).model.reads != "embeddings"


@pytest.mark.parametrize(
    ("name", "shift", "farthest"), [("keyed", 0.005, 0.005), ("keyed", 0.0, 0.002), ("coarse", 0.005, 0.002)]
)
def test_a_sensor_without_a_reader_of_any_object_is_fitted_to_shifted_ones(name, shift, farthest, monkeypatch):
    fitted_in, make = [], TactileSensor._model

    def made(reader, scene, fitted, unknown_state):
        fitted_in.append(scene)
        return make(reader, SCENES[name].scene, fitted, unknown_state)

    monkeypatch.setattr(TactileSensor, "_model", staticmethod(made))
    scene = replace(SCENES[name].scene, moves=Moves(shift=shift))
    sensor = TactileSensor.shipped(name, scene, anyway=True)
    assert fitted_in[0].moves is None
    assert max(fitted_in[0].variation.offset.support) == farthest
    assert isinstance(sensor.model, MovingBodyModel)
    assert sensor.scene == scene


@pytest.mark.torch
def test_how_an_object_lies_is_how_it_lies_after_its_moves():
    scene = replace(SCENES["coarse"].scene, press_model=Quasistatic(), moves=Moves(0.3, np.deg2rad(15.0), 0.0))
    sensor = TactileSensor.shipped("coarse", scene, anyway=True)
    rng = np.random.default_rng(2)
    obj = scene.sample_object("cone", rng)
    poses = [0, 3, 1, 4]
    images = np.stack([scene.press(obj, pose, rng).image for pose in poses])
    evidence = sensor.model.start()
    for touch in sensor.read(images, poses):
        evidence = evidence.update(touch)
    found = sensor.pose("cone", images, poses)
    np.testing.assert_allclose(found.probs, evidence.probs[sensor.shape_labels.index("cone")], atol=1e-9)
    assert found.error(obj.orientation) < 40.0  # cells alone, not the images of all touches together


@pytest.mark.parametrize("presentation", [Resampled(), Held()])
def test_touches_of_an_object_that_lies_anew_have_its_shape_and_size_in_common(presentation):
    scene = replace(COARSE, presentation=presentation)
    with pytest.warns(SceneShift, match="presentation"):
        sensor = TactileSensor.shipped("coarse", scene)
    model, rng = replace(sensor.model, drift=0.0, correlation=0.0), np.random.default_rng(0)
    world = TouchWorld.sample(sensor, ["cylinder"], rng)
    touches = [world.touch(pose, rng) for pose in (0, 3, 3)]
    found = model.start()
    for touch in touches:
        found = found.update(touch)

    likely = np.exp([model.scores_of(touch, model.embedding_of(touch)) for touch in touches], dtype=np.float64)
    sizes = scene.hypotheses(model.num_hypotheses).sizes
    bins = np.digitize(sizes, np.linspace(*scene.variation.size.support, 9)[1:-1])
    every = [np.prod(likely[:, :, bins == place].mean(axis=2), axis=0) * (bins == place).mean() for place in range(8)]
    expected = np.log(np.sum(every, axis=0))
    np.testing.assert_allclose(found.log_likelihood, expected - expected.max(), rtol=0, atol=1e-5)
