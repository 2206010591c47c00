"""``TactileSensor.search``: one search with a sensor, and nothing else to wire."""

import json

import pytest

import activetouch
from activetouch import TactileSensor
from belief.errors import InvalidArgument, UnknownName
from planners import Episode, make_decider

pytestmark = [pytest.mark.mujoco, pytest.mark.usefixtures("sensors_loaded_once")]


def test_a_search_is_the_one_that_compare_plays_with_the_same_seed(tmp_path):
    activetouch.compare("coarse", "information_gain", targets="cone", episodes=2, seed=7, out=tmp_path, jobs=1)
    played = [json.loads(line) for line in (tmp_path / "episodes.jsonl").read_text().splitlines()]
    sensor = TactileSensor.shipped("coarse")
    for key, expected in zip((7, (7, 3, 1)), played, strict=True):
        episode = json.loads(json.dumps(sensor.search("cone", seed=key).to_dict()))
        assert {name: expected[name] for name in episode} == episode


def test_a_search_prints_its_steps_and_takes_an_object_as_decider():
    sensor = TactileSensor.shipped("coarse")
    decider = make_decider("fixed_poses(max_touches=2)", sensor.model.outcome_table(), sensor.model)
    episode = sensor.search("cube", decider, 1, num_objects=2, composition="independent", touch_cost=0.1)
    assert isinstance(episode, Episode)
    first, *objects = str(episode).splitlines()
    assert first.startswith(f"search for the cube: {episode.outcome.value}, ")
    assert len(objects) == 1 + episode.steps[-1].object_index
    assert all(
        "a " + sensor.scene.shape_labels[shape] in line
        for shape, line in zip(episode.arrangement, objects, strict=False)
    )


def test_wrong_arguments_are_named():
    sensor = TactileSensor.shipped("coarse")
    with pytest.raises(UnknownName, match="cubb"):
        sensor.search("cubb")
    with pytest.raises(UnknownName, match="information_gian"):
        sensor.search("cube", "information_gian")
    with pytest.raises(InvalidArgument, match="seed"):
        sensor.search("cube", seed=-1)
