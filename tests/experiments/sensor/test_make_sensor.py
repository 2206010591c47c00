"""A scene becomes a sensor in one call, which goes on where it stopped."""

from dataclasses import replace

import pytest

import activetouch
from activetouch import SCENES, Quasistatic, Scene, TactileSensor
from activetouch.errors import LabelMismatch
from activetouch.named_scenes import as_named
from activetouch.pressing.contact import Pad
from belief.references import UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.sensor.calibrate import Calibrate, TooFewObjects
from experiments.sensor.train import require_input_size
from planners.probing import read_order

SIZES = {"train": 2, "calibration": 2, "test": 1, "repeats": 1, "epochs": 1, "jobs": 1}


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.slow
def test_a_scene_becomes_a_sensor_in_one_call_and_stays_one(tmp_path):
    coarse = SCENES["coarse"]
    scene = replace(coarse, scene=replace(coarse.scene, press_model=Quasistatic()))
    made = activetouch.make_sensor(scene, tmp_path, **SIZES)
    assert isinstance(made, TactileSensor)
    assert made.shift == ()
    files = [tmp_path / name for name in ("reader.safetensors", "observation_model.json", "evaluation.json")]
    before = [file.stat().st_mtime_ns for file in files]
    activetouch.make_sensor(scene, tmp_path, **SIZES)
    assert [file.stat().st_mtime_ns for file in files] == before
    with pytest.raises(LabelMismatch):
        activetouch.make_sensor(scene, tmp_path, **{**SIZES, "train": 5})
    with pytest.raises(LabelMismatch, match=r"trained with other settings: .'cnn', 16, 'epochs 1"):
        activetouch.make_sensor(scene, tmp_path, **{**SIZES, "epochs": 2})
    with pytest.raises(LabelMismatch, match=r"asked for is .'cnn', 4"):
        activetouch.make_sensor(replace(scene, input_size=4), tmp_path, **SIZES)
    _only_a_readable_model_is_written(tmp_path)


def _only_a_readable_model_is_written(folder):
    trained, out = folder / "training" / "reader.safetensors", folder / "again"
    how = {"reader": trained, "data": folder / "repeats", "out": out}
    Calibrate(**how, observation_model=("ratio", "confusion")).run()
    assert (out / "observation_model.json").exists()
    assert sorted(read_order(out)) == sorted(SCENES["coarse"].scene.pose_labels)
    with pytest.raises(UnknownName, match="Known: confusion"):
        Calibrate(**how, observation_model=("ratio(edges=3)",)).run()


@pytest.mark.parametrize("edge", [7, 67, 134, 201])
def test_the_images_of_a_pad_of_any_size_fit_its_network(edge):
    require_input_size(as_named(Scene(pad=Pad(num_taxels=edge))).input_size, edge, "cnn")


@pytest.mark.mujoco
@pytest.mark.torch
def test_what_cannot_become_a_sensor_is_refused_before_anything_is_recorded(tmp_path):
    with pytest.raises(TooFewObjects):
        activetouch.make_sensor("coarse", tmp_path, **{**SIZES, "test": 0})
    coarse = SCENES["coarse"].scene
    with pytest.raises(TooFewObjects, match="one shape, cube"):
        activetouch.make_sensor(replace(coarse, shapes={"cube": coarse.shapes["cube"]}), tmp_path, **SIZES)
    with pytest.raises(BadArgument, match="--input-size must divide the 4 pixels"):
        activetouch.make_sensor(replace(SCENES["coarse"], input_size=5), tmp_path, **SIZES)
    assert not list(tmp_path.iterdir())
