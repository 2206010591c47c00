"""Hands: what fingers meet, what a grasp looks like, and how it is read."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from activetouch import SCENES, Quasistatic, TactileSensor
from activetouch.distributions import Constant
from activetouch.errors import NoIndependentModel, WrongScene
from activetouch.hand import Hand
from activetouch.orientations import Inexact, Resampled
from activetouch.perception import preparation
from activetouch.perception.contacts import hypotheses as contact_hypotheses
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.poses import turn
from activetouch.scene import Scene, Symmetry, Variation
from activetouch.scene_description import scene_fields
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS, READER_FILE
from activetouch.shapes import Sphere
from belief.errors import InvalidArgument, UnknownName
from belief.problem import Touch
from experiments.sensor.collect import record

COARSE = replace(SCENES["coarse"].scene, press_model=Quasistatic())
EXACT = replace(COARSE, faults=(), variation=Variation(offset=Constant(0.0), force=Constant(2.0)))
READERS = [MODELS / "coarse" / name for name in (READER_FILE, ANY_OBJECT_FILE)]


def grasped(scene: Scene, seed: int = 0, shape: int = 3, pose: int = 1):
    rng = np.random.default_rng(seed)
    return scene.press(scene.sample_object(shape, rng), pose, rng)


@pytest.mark.parametrize("presentation", [COARSE.presentation, Inexact(), Resampled()])
def test_a_grasp_of_one_finger_is_a_touch_to_the_last_bit(presentation):
    alone = replace(COARSE, presentation=presentation)
    touch, grasp = grasped(alone), grasped(alone.with_hand("one_finger"))
    assert np.array_equal(touch.image, grasp.image)
    assert (touch.contact.force, *touch.placement.offset) == (grasp.contact.force, *grasp.placement.offset)
    assert alone.image_shape == alone.with_hand("one_finger").image_shape


@pytest.mark.parametrize("path", READERS)
def test_one_finger_is_read_as_a_touch_to_the_last_bit(path):
    scene = COARSE.with_hand("one_finger")
    alone, held = (TactileReader.load(path).bound_to(one) for one in (COARSE, scene))
    image = grasped(COARSE).image[None]
    assert np.array_equal(alone.run(image)[0], held.run(image)[0])
    assert np.array_equal(HypothesisTable(alone, COARSE).in_pose(8, 2), HypothesisTable(held, scene).in_pose(8, 2))


@pytest.mark.parametrize("name", ["one_finger", "parallel", "three_finger"])  # whose forces are equal
def test_a_grasp_shows_what_single_pads_feel_there(name):
    scene = replace(EXACT, aims={"z45": (0.002, -0.001)}).with_hand(name)
    fingers = scene.fingers
    images = [grasped(one).image for one in fingers]
    assert np.array_equal(grasped(scene).image, np.hstack(images))
    assert scene.image_shape == grasped(scene).image.shape == (4, 4 * len(fingers))


@pytest.mark.parametrize("path", READERS)
def test_the_score_of_a_grasp_is_the_sum_of_its_fingers(path):
    scene, image = COARSE.with_hand("three_finger"), grasped(COARSE.with_hand("three_finger")).image
    reader, alone = TactileReader.load(path).bound_to(scene), TactileReader.load(path)
    scores = HypothesisTable(reader, scene).in_pose(6, 1) @ reader.run(image[None])[0][0]
    expected = sum(
        HypothesisTable(alone, one).in_pose(6, 1) @ alone.run(part[None])[0][0]
        for one, part in zip(scene.fingers, np.split(image, 3, axis=1), strict=True)
    )
    assert scores == pytest.approx(expected, rel=1e-3, abs=1e-3)


def test_opposed_pads_see_an_offset_mirrored():
    scene = replace(EXACT, pad=replace(EXACT.pad), shapes={"ball": Sphere(0.015)}, aims={"front": (0.006, 0.0)})
    first, second = np.split(grasped(scene.with_hand("parallel"), shape=0, pose=0).image, 2, axis=1)
    np.testing.assert_allclose(second.astype(int), first[:, ::-1], atol=1)  # of the facets of the ball
    assert not np.array_equal(second, first)


def test_fingers_share_the_offset_and_the_force_of_their_grasp():
    scene = replace(COARSE, shapes={"ball": Sphere(0.015)}).with_hand("three_finger")
    found = [grasped(scene, seed, shape=0) for seed in range(20)]
    centres = np.array([[part.centre_of_pressure[0] for part in one.contacts] for one in found])
    assert np.abs(centres.sum(axis=1)).max() < 1e-3 < np.abs(centres).max()  # y of three fingers adds up to 0
    assert len({contact.force for one in found for contact in one.contacts}) == 20
    assert max(np.linalg.norm(Hand.three_finger().net_force([c.force for c in one.contacts])) for one in found) < 1e-9


def test_a_finger_that_misses_and_an_empty_hand_are_legal():
    ball = replace(EXACT, shapes={"ball": Sphere(0.010)})
    one_misses = replace(ball, aims={"front": (0.03, 0.0)}).with_hand("three_finger")
    grasp = grasped(one_misses, shape=0, pose=0)
    assert [contact.force > 0.0 for contact in grasp.contacts] == [False, True, True]
    assert not grasp.image[:, :4].any()
    assert grasp.image[:, 4:].any()
    assert np.linalg.norm(one_misses.hand.net_force([contact.force for contact in grasp.contacts])) > 1.0
    empty = grasped(replace(ball, aims={"front": (0.0, 0.1)}).with_hand("parallel"), shape=0, pose=0)
    assert not empty.image.any()
    read = TactileReader.load(READERS[0]).bound_to(COARSE.with_hand("three_finger")).run(grasp.image[None])
    assert np.isfinite(read[0]).all()


@pytest.mark.parametrize("number", [2, 3, 4, 5, 8])
def test_pads_all_around_press_alike(number):
    assert Hand.around(number).forces == pytest.approx(np.ones(number), abs=1e-6)
    assert np.linalg.norm(Hand.around(number).net_force(Hand.around(number).forces)) < 1e-6


@pytest.mark.parametrize(
    ("fingers", "message"),
    [
        ((), "one rotation for each finger"),
        ("ab", "one rotation for each finger"),
        (([1.0, 0.0],), "finger 0 must be a unit quaternion"),
        (([1.0, 0.0, 0.0, 1.0],), "must be a unit quaternion"),
        (([np.nan, 0.0, 0.0, 0.0],), "must be a unit quaternion"),
        ((turn("z", 0.0), -turn("z", 0.0)), "fingers 0 and 1 of the hand are in one place"),
        ((turn("z", 0.0), turn("z", np.pi / 2)), "no forces balance"),
    ],
)
def test_hands_that_cannot_be_are_refused(fingers, message):
    with pytest.raises(InvalidArgument, match=message):
        Hand(fingers)


def test_what_takes_no_hand_says_so(tmp_path):
    scene = COARSE.with_hand("parallel")
    with pytest.raises(UnknownName, match="three_finger"):
        COARSE.with_hand("four_finger")
    with pytest.raises(InvalidArgument, match="hand must be a Hand"):
        COARSE.with_hand(2)
    with pytest.raises(InvalidArgument, match=r"a hand closes by Quasistatic\(\)"):
        replace(SCENES["coarse"].scene, hand=Hand.parallel())
    with pytest.raises(NoIndependentModel, match="one body"):
        TactileSensor.load(MODELS / "coarse", scene, independent=True)
    with pytest.raises(WrongScene, match="single touches"):
        TactileSensor.shipped("paper-independent", SCENES["paper"].scene.with_hand("parallel"), anyway=True)
    with pytest.raises(WrongScene, match="a collection takes single touches"):
        record(scene, None, tmp_path, 1)
    with pytest.raises(ValueError, match="side by side"):
        TactileReader.load(READERS[0]).bound_to(scene).run(np.zeros((1, 4, 4), np.uint8))


def test_a_scene_without_a_hand_is_described_as_before():
    assert "hand" not in scene_fields(COARSE)
    assert scene_fields(COARSE.with_hand("parallel"))["hand"]["class"] == "Hand"
    assert COARSE.with_hand("parallel") != COARSE.with_hand("three_finger")
    assert SCENES["gel"].scene.with_hand("parallel").symmetry is Symmetry.NONE


@pytest.fixture
def sensor(monkeypatch):
    monkeypatch.setattr(contact_hypotheses, "FEWEST", 64)
    monkeypatch.setattr(contact_hypotheses, "MOST", 64)
    monkeypatch.setattr(preparation, "_LEAST", 4)
    monkeypatch.setattr(preparation, "_MOST", 4)
    return TactileSensor.shipped("coarse", SCENES["coarse"].scene.with_hand("parallel"))


def test_a_sensor_searches_with_a_hand(sensor):
    assert sensor.shift == ()
    played = sensor.search("cone", seed=1)
    assert played.success is not None
    assert played.outcome == sensor.search("cone", seed=1).outcome
    images = np.stack([grasped(sensor.scene, seed).image for seed in range(3)])
    together, alone = sensor.read(images, [1, 1, 1]), [sensor.read(images[i : i + 1], [1])[0] for i in range(3)]
    assert np.allclose([touch.features for touch in together], [touch.features for touch in alone], atol=1e-4)
    orders = [sensor.model.start(), sensor.model.start()]
    for i in range(3):
        orders = [orders[0].update(alone[i]), orders[1].update(alone[2 - i])]
    assert orders[0].log_likelihood == pytest.approx(orders[1].log_likelihood, abs=1e-3)
    with pytest.raises(ValueError, match="embedding"):
        sensor.model.start().update(Touch(0, features=alone[0].features[:64]))


def test_a_session_tells_a_grasp_from_no_contact(sensor):
    reader = sensor.image_reader
    image = grasped(sensor.scene).image
    blank = np.hstack([np.zeros((4, 4), np.uint8), image[:, 4:]])
    assert reader.area(image) > reader.area(blank) > reader.area(np.zeros_like(image)) == 0.0
    pose, elsewhere = reader.at({"quaternion": turn("z", 0.3).tolist()})
    assert (pose, elsewhere.hypotheses.shape) == (0, (4, 64, 128))


def test_a_hand_searches_by_the_rules_of_the_named_scene():
    scene = SCENES["hard"].scene
    labels = {"shape_labels": scene.shape_labels, "pose_labels": scene.pose_labels}
    alone, held = (SimpleNamespace(**labels, scene=one) for one in (scene, scene.with_hand("parallel")))
    assert TactileSensor._usual(held) == TactileSensor._usual(alone)
    assert TactileSensor._usual(held)[0].num_objects == 8
