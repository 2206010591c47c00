"""The command adapt, on a few objects."""

from pathlib import Path

import pytest

from activetouch import SCENES, TactileSensor
from activetouch.errors import SceneShift
from activetouch.sensor_files import fitted_model
from belief.errors import InvalidArgument, UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.robustness.adapt import Adapt
from experiments.scene_choice import SceneChoice

pytestmark = pytest.mark.mujoco
COARSE = SceneChoice("coarse")


def test_an_adapted_sensor_is_written_and_can_be_loaded(tmp_path, capsys):
    settings = {"condition": "stiffness × 0.7", "objects": (4,), "test": 2, "out": tmp_path, "jobs": 1}
    Adapt(COARSE, sensor=Path("coarse-robust"), **settings).run()
    said = capsys.readouterr().out
    assert "before" in said
    assert said.count("known") == 2
    stiffness = fitted_model(tmp_path).stiffness
    assert 0.4 < stiffness.low < 0.8 < 1.3 * stiffness.high < 1.6
    with pytest.warns(SceneShift, match="variation.stiffness"):
        sensor = TactileSensor.load(tmp_path, SCENES["coarse"].scene)
    soft, usual = (s.model.table for s in (sensor, TactileSensor.shipped("coarse-robust")))
    assert soft.shape == usual.shape
    assert abs(soft - usual).max() > 0.1


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"condition": "stiffness × 0.8"}, UnknownName, "stiffness × 0.7"),
        ({"choice": SceneChoice("paper"), "condition": "noise × 2"}, BadArgument, "does not apply to paper"),
        ({"sensor": Path("coarse-independent")}, InvalidArgument, "cannot adapt"),
    ],
)
def test_what_cannot_be_adapted_is_refused_before_a_press(settings, error, words, tmp_path):
    with pytest.raises(error, match=words):
        Adapt(**{"choice": COARSE, "out": tmp_path / "out", **settings}).run()
    assert not (tmp_path / "out").exists()
