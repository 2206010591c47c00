"""A shape from a mesh file goes all the way: touches, classifier, observation model, live searches."""

import runpy
from pathlib import Path

import pytest

from activetouch.data.manifest import read_manifest
from activetouch.scene import Symmetry
from activetouch.sensor_files import READER_FILE
from activetouch.shapes import Mesh
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.sensor.calibrate import Calibrate
from experiments.sensor.collect import Collect, PlanArguments
from experiments.sensor.train import Changes, Train

pytestmark = [pytest.mark.mujoco, pytest.mark.torch, pytest.mark.slow, pytest.mark.nightly]
EXAMPLE = Path(__file__).parents[3] / "examples" / "04_a_mesh_of_your_own.py"


def test_a_cup_from_a_file_is_learned_and_searched_for(tmp_path):
    cup = tmp_path / "cup.obj"
    runpy.run_path(str(EXAMPLE))["write_cup"](cup)
    assert Mesh.from_file(cup).surface  # closed, the right way round, of a size that can be felt
    choice = SceneChoice(meshes=(cup,), fidelity="quasistatic")
    data, trained, sensor = tmp_path / "touches", tmp_path / "trained", tmp_path / "sensor"
    Collect(choice, out=data, plan=PlanArguments(train=6, calibration=3, test=2), jobs=1).run()
    assert read_manifest(data).symmetry == Symmetry.ROTATIONS
    how = {"backbone": "cnn", "input_size": 16, "recipe": "large", "change": Changes(epochs=1)}
    Train(data=data, out=trained, **how, jobs=1).run()
    Calibrate(reader=trained / READER_FILE, data=data, out=sensor).run()
    comparison = Compare(
        deciders=("information_gain", "random_confirm"),
        targets=("cup",),
        episodes=4,
        setting=Setting(choice, sensor=sensor, num_objects=5),
        out=tmp_path / "compare",
        jobs=1,
    ).play()
    assert comparison.problem.shape_labels == ("sphere", "cube", "cylinder", "cone", "cup")
    assert comparison.no_touch_baseline == pytest.approx(0.2)
    assert comparison.cells["information_gain", "cup"].num_episodes == 4
