"""``TactileSensor.search``: one search with a sensor, and nothing else to wire."""

import json
from dataclasses import replace

import numpy as np
import pytest

import activetouch
from activetouch import SHAPES, TactileSensor
from activetouch.distributions import Constant
from activetouch.errors import LabelMismatch
from belief.errors import InvalidArgument, UnknownName
from planners import Episode, make_decider

pytestmark = pytest.mark.mujoco


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


def test_an_image_with_masked_taxels_is_refused():
    session = TactileSensor.shipped("coarse").session("cone")
    masked = np.ma.masked_array(np.full((4, 4), 40), np.eye(4, dtype=bool))
    with pytest.raises(InvalidArgument, match=r"an image must be \(4, 4\) whole numbers.*must not be masked"):
        session.tell(image=masked)
    assert session.step == 0


def test_a_sensor_searches_among_other_objects_of_exact_size_without_training(few_hypotheses, tmp_path):
    corners = "".join(f"v {x} {y} {z}\n" for x in (0, 20) for y in (0, 30) for z in (0, 8))
    faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    (tmp_path / "block.obj").write_text(corners + faces)
    gel = TactileSensor.shipped("gel")
    sensor = gel.with_objects({"ball": SHAPES["sphere"], "plate": f"{tmp_path}/block.obj@0.001"})
    assert sensor.shape_labels == ("ball", "plate")
    assert sensor.scene.variation.size == Constant(1.0)
    assert sensor.search("plate", num_objects=2, seed=7).success
    (tmp_path / "slab.obj").write_text(corners.replace(" 30 ", " 12 ") + faces)
    for files in (f"{tmp_path}@0.001", [f"{tmp_path}/block.obj@0.001", f"{tmp_path}/slab.obj@0.001"]):
        assert gel.with_objects(files).shape_labels == ("block", "slab")
    with pytest.raises(InvalidArgument, match="one by one"):
        gel.with_objects([SHAPES["sphere"], SHAPES["cube"]])
    with pytest.raises(InvalidArgument, match="nothing to tell apart"):
        gel.with_objects({"ball": SHAPES["sphere"]})
    with pytest.raises(LabelMismatch, match="reader"):
        TactileSensor.shipped("keyed").with_objects({"ball": SHAPES["sphere"], "cube": SHAPES["cube"]})
    with pytest.raises(InvalidArgument, match="put together from parts"):
        replace(gel, folder=None).with_objects({})
