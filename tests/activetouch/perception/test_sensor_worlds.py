"""A sensor that finds out what is the matter with it."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from activetouch import SCENES, SHAPES, TactileSensor
from activetouch.perception import preparation, sensor_worlds
from activetouch.perception.imaging import SensorState, imaging_of
from activetouch.perception.sensor_worlds import changed_worlds
from activetouch.rendering import StuckTaxels
from activetouch.sensor_files import MODELS
from belief import Probe, SceneBelief, SearchProblem, Unsure
from belief.errors import InvalidArgument


@pytest.fixture
def few_worlds(few_hypotheses, monkeypatch):
    """As described, or with stuck taxels in one of the sixteen cells."""
    whole = changed_worlds

    def some(imaging, usual):
        labels, states = whole(imaging, usual)
        rows = [i for i, label in enumerate(labels) if label.startswith("stuck taxels")]
        return tuple(labels[i] for i in rows), SensorState(*(part[rows] for part in states))

    monkeypatch.setattr(sensor_worlds, "changed_worlds", some)
    monkeypatch.setattr(preparation, "_TOUCHES", 288)


@pytest.mark.parametrize("name", ["gel", "coarse"])
def test_every_world_differs_from_what_is_described_and_is_within_what_readers_know(name):
    imaging = imaging_of(SCENES[name].scene)
    for usual in (
        SensorState.nominal(1),
        SensorState.nominal(1)._replace(noise=np.array([4.0]), shift=np.full((1, 2), 0.1)),
    ):
        labels, states = changed_worlds(imaging, usual)
        codes = states.code()
        assert len(set(labels)) == len(labels) == len(codes)
        if usual.noise == 1.0:
            assert len(np.unique(codes, axis=0)) == len(codes)
            assert np.abs(codes).max(axis=1).min() > 0.01
            is_shifted = np.abs(states.shift).max() > 0.2
            assert is_shifted == (name == "coarse")  # by a taxel, where there are only four
        for part_name, (low, high) in imaging.limits.items():
            part = getattr(states, part_name)
            np.testing.assert_array_equal(part, np.clip(part, np.float32(low), np.float32(high)), part_name)


def test_a_sensor_that_is_prepared_says_so_once_in_python_too(few_worlds, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sensor_worlds, "EmbeddedWorlds", partial(sensor_worlds.EmbeddedWorlds, number=2))
    monkeypatch.setattr(preparation, "_TOUCHES", 10)
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path))
    solids = {name: SHAPES[name] for name in ("cube", "sphere")}
    line = "preparing the sensor: up to two minutes the first time, then kept in the cache\n"
    assert TactileSensor.shipped("coarse").shape_labels
    assert capsys.readouterr().err == ""
    for said in (line, ""):
        TactileSensor.shipped("coarse", unknown_state=True)
        assert capsys.readouterr().err == said
    for said in (line, ""):
        TactileSensor.shipped("coarse").with_objects(solids)
        assert capsys.readouterr().err == said


def test_a_stuck_taxel_is_found_and_named(few_worlds):
    described = SCENES["coarse"].scene
    scene = replace(described, faults=(*described.faults, StuckTaxels(1 / 16)))
    sensor = TactileSensor.load(MODELS / "coarse", described, unknown_state=True)
    problem = SearchProblem(scene.shape_labels, scene.pose_labels, num_objects=1, composition="independent")
    rng, bets, found = np.random.default_rng(1), 0.0, 0
    for number in range(6):
        obj = scene.sample_object(number % 4, rng)
        belief = SceneBelief(problem, sensor.model, log_bets=bets)
        images = np.stack([scene.press(obj, pose, rng).image for pose in range(4)])
        found += int(belief.update(0, sensor.read(images, range(4))).probs.argmax()) == number % 4
        bets = belief.view().log_bets
    stuck = np.zeros((4, 4), bool)
    for fault in scene.faults:
        if isinstance(fault, StuckTaxels):
            stuck = fault(np.zeros((4, 4)), rng) == 1.0
    row, column = np.argwhere(stuck)[0] + 1
    health = belief.view().sensor_health
    assert health.labels[int(health.probs.argmax())] == f"stuck taxels in row {row}, column {column} of 4"
    assert found >= 4


def test_a_sensor_without_a_reader_of_any_object_says_so():
    with pytest.raises(InvalidArgument, match="no reader of any object"):
        TactileSensor.load(MODELS / "paper", SCENES["paper"].scene, unknown_state=True)
    with pytest.raises(InvalidArgument, match="leave out --unknown-state or --hand"):
        TactileSensor.shipped("coarse", SCENES["coarse"].scene.with_hand("three_finger"), unknown_state=True)


def test_another_process_is_sent_no_tables_and_has_the_same(few_worlds):
    scene = SCENES["coarse"].scene
    worlds = TactileSensor.load(MODELS / "coarse", scene, unknown_state=True).model.worlds
    sent = pickle.dumps(worlds)
    assert not any(worlds.in_pose(pose).tobytes()[:4096] in sent for pose in range(len(scene.poses)))
    np.testing.assert_array_equal(pickle.loads(sent).in_pose(0), worlds.in_pose(0))


@pytest.mark.parametrize("state", [pytest.param(True, marks=pytest.mark.nightly), None])
def test_a_pad_of_switches_is_like_no_state_of_the_sensor(state, few_worlds, monkeypatch):
    monkeypatch.setattr(sensor_worlds, "_SIMULATED", 6144)
    scene = SCENES["gel"].scene
    sensor, rng = TactileSensor.shipped("gel", unknown_state=state), np.random.default_rng(2)
    for number in range(3):
        obj, session = scene.sample_object(number, rng), sensor.naming(seed=number, unlisted=0.0)
        while isinstance(asked := session.ask(), Probe):
            image = scene.press(obj, asked.pose, rng).image
            session.tell(image=255 * (image > 60).astype(np.uint8))
        assert session.ask() == Unsure()
        assert session.step < 3


@pytest.mark.mujoco
def test_a_session_that_goes_on_with_its_log_doubts_as_much_as_before(few_worlds, tmp_path, rng):
    """Doubts read images again, which are in the log."""
    sensor, log = TactileSensor.shipped("coarse", doubting=True), tmp_path / "log"
    session = sensor.session("cone", log=log)
    for pose in ("front", "y45", "corner", "z45", "y90"):
        session.tell(image=rng.integers(256, size=(4, 4)), pose=pose)
    session.close()
    resumed = sensor.session("cone", log=log)
    for felt, read in zip(session.steps, resumed.steps, strict=True):
        np.testing.assert_array_equal(felt.touch.image, read.touch.image)
        assert felt.belief.log_probs.tobytes() == read.belief.log_probs.tobytes()
    assert resumed.belief.log_probs.tobytes() == session.belief.log_probs.tobytes()
    assert resumed.scene.log_conflict == session.scene.log_conflict
    assert str(resumed.scene.sensor_health) == str(session.scene.sensor_health) != "as described"
    assert resumed.ask() == session.ask()
