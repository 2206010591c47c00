"""When a sensor doubts its description: presses of what is believed, and coarse alternatives."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from activetouch import SCENES, TactileSensor, TouchWorld
from activetouch.perception.contacts.images import binned, images
from activetouch.perception.imaging import SensorState, imaging_of, sensor_state
from activetouch.perception.pressed_beliefs import Residuals, images_of, oddness
from activetouch.perception.sensor_worlds import changed_worlds
from activetouch.pressing.height_maps import predicted_contacts
from activetouch.rendering import StuckTaxels
from activetouch.sensor_files import MODELS
from belief import SceneBelief
from belief.errors import InvalidArgument
from belief.naming import UNLISTED
from experiments.robustness.conditions import CONDITIONS
from experiments.sensor_choice import asked_state


def maps_of(name, number, rng):
    """Height maps of cubes in random orientations."""
    scene, turns = SCENES[name].scene, rng.normal(size=(number, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    solid = scene.solids["cube"]
    return predicted_contacts(solid, turns, (0.001, 0.0), imaging_of(scene).window, 1.0, np.float32)


@pytest.mark.parametrize("name", ["coarse", "gel"])
def test_pressed_images_are_those_that_readers_are_trained_with(name, rng):
    scene = SCENES[name].scene
    imaging = replace(imaging_of(scene), force=(2.0, 2.0), gain=0.0)
    _, states = changed_worlds(imaging, sensor_state(imaging, scene))
    maps = maps_of(name, 400, rng)[:1].repeat(400, axis=0)
    for which in rng.choice(len(states.noise), 8, replace=False):
        state = SensorState(*(part[which : which + 1] for part in states))
        random = torch.Generator().manual_seed(0)
        wanted, _ = images(imaging, torch.from_numpy(maps), state, np.zeros(len(maps), int), random)
        got = images_of(imaging, maps, state, rng)
        wanted = binned(wanted, got.shape[-1]).numpy()
        np.testing.assert_allclose(got.mean(axis=0), wanted.mean(axis=0), atol=0.03)
        np.testing.assert_allclose(got.std(axis=0), wanted.std(axis=0), atol=0.03)


def test_usual_images_are_not_odd_and_strange_ones_are(rng):
    def residuals(shift=0.0, same=0.0):
        drawn = [rng.normal(0.5, 0.1, (32, 4, 4)) for _ in range(3)]
        return Residuals.of([rng.normal(0.5 + same, 0.1, (4, 4)) + rng.choice([-shift, shift]) for _ in drawn], drawn)

    usual = [oddness([residuals(), residuals()]) for _ in range(100)]
    assert np.mean(np.array(usual) < 2.5) > 0.9
    assert oddness([residuals(shift=0.4)]) > 3.0
    assert oddness([residuals(same=0.15) for _ in range(4)]) > 3.0  # little, and in every touch


@pytest.mark.mujoco
def test_a_sensor_doubts_its_description_only_where_something_is_the_matter():
    sensor = TactileSensor.shipped("coarse", unknown_state=None)
    described, doubts = sensor.scene, sensor.model.doubts
    stuck = replace(described, faults=(*described.faults, StuckTaxels(1 / 16)))
    asked = {}
    for scene in (described, stuck):
        rng, objects = np.random.default_rng(4), []
        for number in range(3):
            obj = scene.sample_object(number, rng)
            felt = np.stack([scene.press(obj, pose, rng).image for pose in range(3)])
            objects.append(sensor.model.start().updated(sensor.read(felt, range(3))))
        asked[scene is stuck] = doubts.are_odd(objects, 0.0)
    assert asked == {False: False, True: True}
    assert doubts.are_odd(objects[:0], 5.0)  # the conflict test alone


@pytest.mark.mujoco
def test_random_bodies_explain_a_stranger_better_than_the_shapes_and_no_listed_object():
    sensor, ratios = TactileSensor.shipped("gel", unknown_state=None, other_proportions=True), {}
    for shape in (UNLISTED, 0, 1, 2, 3):
        found = []
        for seed in range(4):
            rng = np.random.default_rng([seed, 7])
            world = TouchWorld.sample(sensor, [shape], rng)
            evidence = sensor.model.start().updated([world.touch(pose, rng) for pose in (0, 2)])
            found.append(sensor.model.doubts.log_stranger(evidence))
        ratios[shape] = np.median(found)
    assert ratios.pop(UNLISTED) > 0.0
    assert max(ratios.values()) < -3.0


@pytest.mark.mujoco
def test_in_its_own_world_searches_are_those_of_the_nominal_model():
    doubting, plain = TactileSensor.shipped("coarse", unknown_state=None), TactileSensor.shipped("coarse")
    assert not hasattr(plain.model, "doubts")
    for seed in (2, 3):
        found, wanted = (sensor.search("cone", seed=seed) for sensor in (doubting, plain))
        assert [step.decision.action for step in found.steps] == [step.decision.action for step in wanted.steps]
        scene = SceneBelief(doubting.problem(), doubting.model)
        for step in found.steps:
            if step.touch is not None:
                assert step.touch.image.shape == doubting.scene.image_shape
                scene.update(step.object_index, [step.touch])
        assert str(scene.sensor_health) == "as described"


@pytest.mark.mujoco
def test_bodies_of_other_proportions_are_no_reason_for_a_doubt_where_they_are_expected():
    odd = []
    for expected in (False, True):
        sensor = TactileSensor.shipped("coarse", unknown_state=None, other_proportions=expected)
        short, rng = CONDITIONS["cylinder × 0.5"](sensor.scene), np.random.default_rng(1)
        objects = []
        for _ in range(2):
            obj = short.sample_object("cylinder", rng)
            felt = np.stack([short.press(obj, pose, rng).image for pose in range(5)])
            objects.append(sensor.model.start().updated(sensor.read(felt, range(5))))
        odd.append(sensor.model.doubts.are_odd(objects, 0.0))
    assert odd == [True, False]


def test_a_sensor_whose_taxels_all_read_the_same_tells_nothing():
    sensor = TactileSensor.shipped("coarse", unknown_state=None)
    doubts, likely = sensor.model.doubts, np.zeros((1, 4))
    blank = sensor.model.start().updated(sensor.read(np.full((2, 4, 4), 7, np.uint8), range(2)))
    assert doubts.are_odd([blank], 0.0)
    assert doubts.explained([blank], likely, "healthy").log_unexplained > 10.0
    assert not doubts.are_odd([], 0.0)


def test_who_cannot_doubt_its_description_says_so():
    for name in ("paper", "many"):
        with pytest.raises(InvalidArgument, match="leave out the doubt"):
            TactileSensor.load(MODELS / name, SCENES[name].scene, unknown_state=None)
    with pytest.raises(InvalidArgument, match="contradict"):
        asked_state(unknown=True, doubted=True)
    assert asked_state(unknown=False, doubted=True) is None
    assert asked_state(unknown=True, doubted=False)
