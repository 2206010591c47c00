"""A sensor adapts to a softer pad by touches of a few objects, with and without their shapes."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES, Quasistatic, TactileSensor
from activetouch.adaptation import GRID, StiffnessPosterior, adapted, stiffness_posterior
from activetouch.distributions import Constant
from belief import Touch
from belief.errors import InvalidArgument
from belief.touch_batch import TouchBatch
from experiments.robustness.conditions import CONDITIONS

STIFFNESS, NUM_OBJECTS = 0.7, 24


@pytest.fixture(scope="module")
def sensor():
    return TactileSensor.shipped("coarse-robust")


@pytest.fixture(scope="module")
def touched(sensor):
    """Touches of objects on a soft pad, one sequence each, and the shapes of the objects."""
    scene = sensor.scene
    scene = replace(scene, press_model=Quasistatic(), variation=replace(scene.variation, stiffness=Constant(STIFFNESS)))
    rng = np.random.default_rng(0)
    sequences: list[list[Touch]] = []
    for number in range(NUM_OBJECTS):
        thing = scene.sample_object(number % 4, rng)
        images = np.stack([scene.press(thing, pose, rng).image for pose in range(6)])
        sequences.append(sensor.read(images, list(range(6))))
    return TouchBatch.of(sequences), np.arange(NUM_OBJECTS) % 4


@pytest.mark.parametrize("known", [True, False])
def test_touches_tell_the_stiffness(sensor, touched, known):
    touches, shapes = touched
    found = stiffness_posterior(sensor, touches, shapes if known else None)
    low, high = found.interval
    assert 0.8 * low < STIFFNESS < 1.2 * high
    assert high / low < 1.6
    assert low < found.mode < high
    np.testing.assert_allclose(np.exp(found.log_probs).sum(), 1.0)


def test_an_adapted_sensor_has_bodies_of_that_stiffness_and_keeps_the_rest(sensor, touched):
    fitted, found = adapted(sensor, *touched)
    assert fitted.reader is sensor.reader
    assert fitted.model.num_hypotheses == sensor.model.num_hypotheses
    low, high = found.interval
    bodies = fitted.model.hypotheses.hypotheses(256)
    assert low <= bodies.stiffnesses.min() < low * (high / low) ** 0.1
    assert high >= bodies.stiffnesses.max() > high * (low / high) ** 0.1
    assert 0.5 < fitted.model.temperature / sensor.model.temperature < 2.0
    unlabelled, _ = adapted(sensor, touched[0])
    assert unlabelled.model.temperature == sensor.model.temperature
    assert found.interval[0] > GRID[0]


def test_without_stiffness_the_temperature_still_adapts():
    sensor = TactileSensor.shipped("coarse")
    noisy = CONDITIONS["noise × 4"](sensor.scene)
    rng, sequences = np.random.default_rng(1), []
    for number in range(NUM_OBJECTS):
        thing = noisy.sample_object(number % 4, rng)
        images = np.stack([noisy.press(thing, pose, rng).image for pose in range(6)])
        sequences.append(sensor.read(images, list(range(6))))
    fitted, stiffness = adapted(sensor, TouchBatch.of(sequences), np.arange(NUM_OBJECTS) % 4)
    assert stiffness is None
    assert fitted.model.temperature > 1.5 * sensor.model.temperature
    assert fitted.model.hypotheses is sensor.model.hypotheses
    assert fitted.model.conflict is not None


def test_without_information_every_stiffness_stays_possible():
    low, high = StiffnessPosterior(np.full(len(GRID), -np.log(len(GRID)))).interval
    assert low <= GRID[0]
    assert high >= GRID[-1]


def test_the_range_of_stiffnesses_ends_half_a_step_of_the_grid_beyond_its_values():
    step = GRID[1] / GRID[0]
    for first, last in ((7, 7), (3, 11), (0, len(GRID) - 1)):
        probs = np.zeros(len(GRID))
        np.add.at(probs, [first, last], 0.5)
        with np.errstate(divide="ignore"):
            found = StiffnessPosterior(np.log(probs))
        assert found.interval == pytest.approx((GRID[first] / np.sqrt(step), GRID[last] * np.sqrt(step)))
        assert found.mode == GRID[first]


def test_what_cannot_adapt_is_refused(sensor, touched):
    with pytest.raises(InvalidArgument, match="do not tell stiffness"):
        adapted(TactileSensor.shipped("coarse"), touched[0])
    with pytest.raises(InvalidArgument, match="cannot adapt"):
        adapted(TactileSensor.shipped("coarse-independent"), *touched)
    with pytest.raises(InvalidArgument, match="at least one object"):
        stiffness_posterior(sensor, touched[0].sequences(slice(0, 0)))


def test_every_scene_is_known_to_robust_sensors():
    assert TactileSensor.shipped("coarse-robust").scene == SCENES["coarse"].scene
