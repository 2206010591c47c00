"""A scene becomes a sensor in one call, which goes on where it stopped."""

from dataclasses import replace

import pytest

import activetouch
from activetouch import SCENES, Quasistatic, TactileSensor
from activetouch.errors import LabelMismatch
from belief.references import BadReference
from experiments.scene_choice import as_named
from experiments.sensor.calibrate import Calibrate

SIZES = {"train": 4, "calibration": 2, "test": 1, "repeats": 1, "epochs": 2, "jobs": 1}


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
    _only_a_readable_model_is_written(tmp_path)


def _only_a_readable_model_is_written(folder):
    trained, out = folder / "training" / "reader.safetensors", folder / "again"
    how = {"reader": trained, "data": folder / "repeats", "out": out}
    Calibrate(**how, observation_model=("ratio", "confusion(confidence_edges=(0.9,))")).run()
    assert (out / "observation_model.json").exists()
    with pytest.raises(BadReference, match="unexpected"):
        Calibrate(**how, observation_model=("ratio(edges=3)",)).run()


@pytest.mark.parametrize(("name", "size"), [("gel", 64), ("coarse", 16), ("paper", 64)])
def test_the_images_of_a_scene_fit_its_network(name, size):
    scene = SCENES[name].scene
    assert as_named(scene).input_size == size or scene.image_shape[0] % as_named(scene).input_size == 0
