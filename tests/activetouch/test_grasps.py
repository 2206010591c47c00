"""What the belief makes of grasps: the body's position in the palm, and how far fingers travel."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from activetouch import SCENES, Quasistatic, TactileSensor
from activetouch.distributions import Constant, Uniform
from activetouch.errors import WrongScene
from activetouch.hand import Hand
from activetouch.perception import preparation
from activetouch.perception.contacts import hypotheses as contact_hypotheses
from activetouch.perception.grasps import predicted_stops
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.poses import POSE_SETS
from activetouch.pressing.height_maps import Window, predicted_contacts
from activetouch.scene import Variation
from activetouch.sensor.session_reader import SensorReader
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS, READER_FILE, reader_file
from belief.errors import InvalidArgument, UnknownName
from belief.observation_model import FixedHypotheses, RigidBodyModel
from belief.policy_state import expected_gains
from belief.problem import Probe, Touch

COARSE = SCENES["coarse"].scene
WIDE = replace(
    COARSE,
    press_model=Quasistatic(),
    shapes={label: COARSE.shapes[label] for label in ("cube", "cone")},
    poses={label: COARSE.poses[label] for label in ("front", "z45")},
    variation=Variation(offset=Uniform(-0.006, 0.006)),
)
ANY_OBJECT = TactileReader.load(MODELS / "coarse" / ANY_OBJECT_FILE)
NUMBER, TEMPERATURE = 12, 1.7


def held(offset, hand=None, **others):
    return replace(WIDE, hand=replace(Hand.parallel() if hand is None else hand, offset=offset, **others))


def grasped(scene, seed, pose=1):
    rng = np.random.default_rng(seed)
    obj = scene.sample_object("cone", rng)
    return obj, scene.press(obj, pose, rng)


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(contact_hypotheses, "FEWEST", 8)
    monkeypatch.setattr(contact_hypotheses, "MOST", 8)


def evidence_of(scene, images):
    """The evidence of grasps in turn, in pose 0, 1, 0 ..., and their embeddings."""
    reader = ANY_OBJECT.bound_to(scene)
    table, embedded = HypothesisTable(reader, scene)(NUMBER), reader.run(np.stack(images))[0]
    references, logits = np.ones((2, 1, embedded.shape[1])), np.zeros((2, 1, 2))
    model = RigidBodyModel(
        scene.shape_labels, NUMBER, TEMPERATURE, references, logits, hypotheses=FixedHypotheses(table)
    )
    evidence = model.start()
    for step, row in enumerate(embedded):
        evidence = evidence.update(Touch(step % 2, features=row))
    return evidence, embedded


def beside(scene, finger, pose, aim, bodies):
    """Embedded hypotheses of one finger at one place beside its axis, by hand."""
    single = scene.fingers[finger]
    label = single.pose_labels[pose]
    return ANY_OBJECT.hypotheses.embedded(replace(single, aims={label: tuple(aim)}), bodies, pose)


@pytest.mark.parametrize("offset", ["anew", "kept"])
def test_the_belief_over_positions_in_the_palm_is_that_of_all_of_them_one_by_one(offset):
    scene = held(offset)
    evidence, embedded = evidence_of(scene, [grasped(scene, seed, pose=seed)[1].image for seed in range(2)])
    along = scene.hand.places(scene.variation.offset, 0.002)[:3, 2]
    assert along == pytest.approx([-0.004, 0.0, 0.004], abs=1e-5)
    bodies, which = scene.hypotheses(NUMBER), np.zeros(NUMBER, int)
    places = [(0.0, y, z) for y in along for z in along]
    if offset == "kept":
        places = [(x, y, z) for x in along for y in along for z in along]
        which = np.floor(27 * ((0.5 + 0.8191725133961645 * np.arange(NUMBER)) % 1.0)).astype(int)
    expected = np.zeros((2, NUMBER))
    for pose, row in enumerate(embedded):
        quarter = pose * np.pi / 4 if offset == "kept" else 0.0  # z45 turns the body, and what is kept with it
        scores = np.full((len(places), 2, NUMBER), -np.inf)
        for number, (x, y, z) in enumerate(places):
            across = np.sin(quarter) * x + np.cos(quarter) * y
            rows = np.arange(NUMBER) if offset == "anew" else np.flatnonzero(which == number)
            if len(rows):
                scores[number][:, rows] = sum(
                    beside(scene, finger, pose, (side * across, z), bodies.take(rows)) @ part
                    for finger, side, part in zip((0, 1), (1.0, -1.0), np.split(row, 2), strict=True)
                )
        expected += logsumexp(scores, axis=0) / TEMPERATURE
    found = evidence.log_weights
    assert found == pytest.approx(expected - expected.max(), abs=1e-3)


def test_fingers_meet_what_a_hypothesis_at_the_position_of_the_body_predicts():
    scene = replace(held("kept", Hand.three_finger()), variation=Variation(offset=Constant(0.0), force=Constant(2.0)))
    place = np.array([0.003, -0.006, 0.004])
    rng = np.random.default_rng(0)
    obj = replace(scene.sample_object("cone", rng), offset=place)
    for pose, turn in ((0, np.eye(3)), (1, np.array([[1, -1, 0], [1, 1, 0], [0, 0, 2**0.5]]) / 2**0.5)):
        contacts = scene.press(obj, pose, rng).contacts
        for one, across, contact in zip(scene.fingers, scene.hand.across(turn @ place), contacts, strict=True):
            window = Window.of(scene.pad)
            rotation = one.place(replace(obj, offset=None), pose, rng).orientation
            heights = predicted_contacts(scene.solids["cone"], [rotation], across, window, [obj.scale])[0]
            assert np.allclose(heights.max() - heights, contact.gap, atol=1e-5)


def test_where_nothing_is_latent_nothing_is_summed():
    assert len(ANY_OBJECT.bound_to(held("averaged")).hypotheses.places) == 1
    narrow = replace(held("anew"), variation=Variation())
    assert len(ANY_OBJECT.bound_to(narrow).hypotheses.places) == 1
    assert np.array_equal(
        HypothesisTable(ANY_OBJECT.bound_to(narrow), narrow)(8),
        HypothesisTable(ANY_OBJECT.bound_to(held("averaged")), held("averaged"))(8),
    )
    assert [
        len(ANY_OBJECT.bound_to(held("anew", hand)).hypotheses.places)
        for hand in (Hand.one_finger(), Hand.parallel(), Hand.three_finger())
    ] == [9, 9, 27]
    again = ANY_OBJECT.bound_to(held("anew")).bound_to(replace(WIDE, hand=None))
    assert type(again.hypotheses) is type(ANY_OBJECT.hypotheses)
    assert grasped(held("anew"), 0)[0].offset is None
    assert np.abs(grasped(held("kept"), 0)[0].offset).max() <= 0.006


def test_only_a_reader_of_any_object_knows_positions_in_the_palm():
    scene = COARSE.with_hand(replace(Hand.parallel(), offset="anew"))
    with pytest.raises(WrongScene, match="leave offset averaged"):
        TactileReader.load(MODELS / "coarse" / READER_FILE).bound_to(scene)
    assert reader_file(MODELS / "coarse", scene).name == ANY_OBJECT_FILE
    assert reader_file(MODELS / "coarse", COARSE.with_hand("parallel")).name == READER_FILE


def test_travel_tells_the_opening_and_no_depth_in_the_palm():
    scene = held("averaged", travel=0.0002)
    assert scene.image_shape == (4, 10)
    for seed in range(5):
        obj, grasp = grasped(scene, seed)
        assert (grasp.image.shape, grasp.ideal.shape) == ((4, 10), (4, 8))
        stops = scene.hand.apart(grasp.image[None])[1][0]
        bodies = scene.hypotheses(1)._replace(rests=np.array([obj.orientation]), sizes=np.array([obj.scale]))
        lateral = scene.hand.across((0.0, *grasp.placement.offset))
        expected = [
            predicted_stops(replace(one, aims={"z45": tuple(across)}), bodies, 1)[1, 0]
            for one, across in zip(scene.fingers, lateral, strict=True)
        ]
        assert stops.sum() == pytest.approx(sum(expected), abs=0.0015)
    without = grasped(held("averaged"), 3)[1].image
    assert np.array_equal(np.delete(grasped(scene, 3)[1].image, [4, 9], axis=1).shape, without.shape)


def test_travel_enters_the_evidence_as_a_gaussian_density():
    scene = held("averaged", travel=0.001)
    grasps = ANY_OBJECT.bound_to(scene).hypotheses
    bodies, stops = scene.hypotheses(8), np.array([[0.015, 0.021]])
    table = grasps.embedded(scene, bodies, 0)[..., -3:]
    predicted = np.stack([predicted_stops(one, bodies, 0) for one in scene.fingers], axis=2)
    radius = np.mean([solid.bounding_radius for solid in scene.solids.values()])
    turned = 0.5 * radius * contact_hypotheses.cell_of(8)
    shared = 0.012**2 / 12 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    density = multivariate_normal(cov=(0.001**2 + turned**2) * np.eye(2) + shared).logpdf(stops - predicted)
    found = table @ grasps.of_travel(stops)[0]
    assert found - found.max() == pytest.approx(density - density.max(), rel=0.05, abs=0.05)


def test_a_finger_that_misses_closes_to_the_middle_and_no_contact_is_seen_beside_travel():
    scene = replace(held("averaged", travel=0.0002), aims={"front": (0.0, 0.1)})
    image = grasped(scene, 0, pose=0)[1].image
    assert image[:, [4, 9]].min() >= 253
    assert not np.delete(image, [4, 9], axis=1).max() > 60
    reader = ANY_OBJECT.bound_to(scene)
    assert np.isfinite(reader.run(image[None])[0]).all()
    of_session = SensorReader(scene, reader, None, None)
    assert of_session.area(image) == 0.0
    seen = grasped(scene, 0, pose=1)[1].image
    assert of_session.area(seen) > 0.0


@pytest.fixture
def briefly_fitted(monkeypatch):
    monkeypatch.setattr(preparation, "_LEAST", 3)
    monkeypatch.setattr(preparation, "_MOST", 3)


@pytest.mark.filterwarnings("ignore::activetouch.errors.AlikeShapes")
def test_an_environment_takes_one_grasp_for_one_action(briefly_fitted):
    env = gymnasium.make("activetouch/ObjectTest-v0", scene="coarse", target="cone", hand="parallel", touch_cost=0.1)
    env.reset(seed=0)
    _, reward, ended, _, info = env.step(2)
    assert (reward, ended, info["num_touches"]) == (-0.1, False, 1)
    assert env.unwrapped.last_image.shape == (4, 8)
    envs = gymnasium.make_vec("activetouch/ObjectSearch-v0", num_envs=2, touches=env.unwrapped.touches, touch_cost=0.1)
    envs.reset(seed=0)
    _, rewards, _, _, found = envs.step(np.array([0, 5]))
    assert rewards.tolist() == [-0.1, -0.1]
    assert found["num_touches"].tolist() == [1, 1]
    with pytest.raises(UnknownName, match="three_finger"):
        gymnasium.make("activetouch/ObjectTest-v0", scene="coarse", hand="seven")
    with pytest.raises(InvalidArgument, match="leave out the hand"):
        gymnasium.make("activetouch/ObjectTest-v0", touches=env.unwrapped.touches, hand="parallel")


@pytest.mark.filterwarnings("ignore::activetouch.errors.AlikeShapes")
def test_information_gain_chooses_among_many_rotations_of_the_palm(briefly_fitted):
    directions = dict(list(POSE_SETS["directions26"].items())[:14])
    scene = replace(held("averaged"), poses=directions, variation=Variation())
    sensor = TactileSensor.load(MODELS / "coarse", scene)
    played = [sensor.search("cone", "information_gain", seed=seed, num_objects=2) for seed in range(2)]
    chosen = {
        step.decision.action.pose for one in played for step in one.steps if isinstance(step.decision.action, Probe)
    }
    assert len(chosen) > 1
    assert max(chosen) >= len(COARSE.poses)
    evidence, prior = sensor.model.start(), np.full(2, -np.log(2))
    gains = expected_gains(evidence, prior, 0)
    first = {
        next(step.decision.action.pose for step in one.steps if isinstance(step.decision.action, Probe))
        for one in played
    }
    assert all(gains[pose] == pytest.approx(gains.max(), abs=1e-6) for pose in first)


def test_an_empty_hand_and_a_finger_that_misses_are_evidence_as_any_other():
    scene = held("anew")
    ball = replace(scene, shapes={"cone": scene.solids["cone"]})
    images = []
    for aim in ((0.0, 0.1), (0.045, 0.0)):
        there = replace(ball, aims={"front": aim}, variation=Variation(offset=Constant(0.0)))
        images.append(grasped(there, 0, pose=0)[1].image)
    assert all(np.isfinite(evidence_of(scene, [image, images[0]])[0].log_weights).all() for image in images)


@pytest.mark.parametrize("change", [{"offset": "both"}, {"travel": 0.0}, {"travel": np.nan}, {"travel": 1}])
def test_hands_say_what_offset_and_travel_may_be(change):
    with pytest.raises(InvalidArgument, match=next(iter(change))):
        replace(Hand.parallel(), **change)
