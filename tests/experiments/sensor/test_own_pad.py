"""Commands with a described pad: a picture of a press, and the fit of its response."""

import shutil

import numpy as np
import pytest
import trimesh

from activetouch import PadDescription, Response, Taxels, read_meshes, read_pad
from activetouch.errors import WrongScene
from activetouch.perception import described_pads
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from belief.errors import InvalidArgument
from benchmarks.pad_fits import RADIUS, simulated
from experiments.command_line.arguments import BadArgument, Trust
from experiments.meshes.setting import reader_of, scene_of
from experiments.press.touch import TouchCommand
from experiments.scene_choice import SceneChoice, choice_name
from experiments.search.page import story
from experiments.sensor.pad_fit import PadFitCommand
from experiments.sensor_choice import open_sensor

KNOWN = {
    "gain": 1.0,
    "blur": 0.2,
    "crosstalk": 0.0,
    "threshold": [0.0, 0.2],
    "stiffness": [4e6, 4e7],
    "law": [0.7, 2.0],
}
PAD = PadDescription(Taxels.grid(4, 4, 0.005), Response.of(KNOWN), (1.0, 8.0), full_scale=4e4)


@pytest.fixture
def mine(tmp_path):
    PAD.save(tmp_path / "mine.toml")
    return tmp_path / "mine.toml"


def test_a_scene_is_touched_by_a_pad(mine):
    choice = SceneChoice("hard", pad=mine)
    scene = choice.named.scene
    assert scene.pad.layout == PAD.taxels
    assert len(scene.shapes) == 12
    assert choice_name(choice) == "hard-mine"
    assert SceneChoice.from_dict(choice.to_dict(), Trust(mine)) == choice
    for other in ({"hand": "parallel"}, {"fidelity": "dynamic"}, {"renderer": "gelsight"}):
        with pytest.raises(InvalidArgument, match="--pad"):
            _ = SceneChoice("gel", pad=mine, **other).named


def test_a_sensor_of_a_pad_and_a_scene_without_it_say_what_does_not_fit_and_what_to_do(mine, tmp_path):
    folder = tmp_path / "sensor"
    folder.mkdir()
    shutil.copy(mine, folder / "pad.toml")
    shutil.copy(MODELS / "coarse" / ANY_OBJECT_FILE, folder)  # which does not read the scene either
    with pytest.raises(WrongScene, match=rf"for a pad of your own: add --pad {folder}/pad\.toml") as failed:
        open_sensor(folder, SceneChoice("paper"))
    assert "pad is Pad" not in str(failed.value)
    with pytest.raises(WrongScene, match=r"pad\.layout is Taxels, not None") as failed:
        open_sensor(MODELS / "coarse", SceneChoice("gel", pad=mine))
    assert f"activetouch train --pad {mine}" in str(failed.value)
    assert "Leave out --sensor" in str(failed.value)


@pytest.mark.nightly  # a described pad is searched with in tests of its sensor
@pytest.mark.filterwarnings("ignore::activetouch.errors.AlikeShapes")
def test_a_described_pad_needs_no_training(mine, few_hypotheses, monkeypatch, tmp_path):
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "cache"))
    sensor = open_sensor(None, SceneChoice("coarse", pad=mine))
    assert len(sensor.model.nominal.world_labels) == described_pads.PADS
    episode = sensor.search("cube", seed=1, num_objects=2)
    told = story(sensor, sensor.problem(2), "", episode)  # of a report: what was felt, and bodies as believed
    assert any(name for name, *_, picture in told["panels"][0]["bars"] if picture is not None)
    box = trimesh.creation.box([0.02, 0.02, 0.01])
    box.export(tmp_path / "plate.stl")
    scene = scene_of(read_meshes(tmp_path), mine)
    assert scene.pad.layout == PAD.taxels
    assert reader_of(mine).digest == sensor.reader.digest


@pytest.mark.mujoco
@pytest.mark.usefixtures("usual_pictures")
def test_a_press_on_a_pad_is_drawn(mine, tmp_path, capsys):
    TouchCommand(SceneChoice(pad=mine), shape="cube", out=tmp_path / "taxels.png").run()
    said = capsys.readouterr().out
    assert "of 16 taxels feel it" in said
    assert (tmp_path / "taxels.png").stat().st_size > 10_000
    with pytest.raises(BadArgument, match="--pad"):
        TouchCommand(SceneChoice(pad=mine), all=True, out=tmp_path / "all.png").run()


@pytest.mark.usefixtures("usual_pictures")
def test_a_pad_is_fitted_on_the_command_line(mine, tmp_path, capsys):
    given = simulated(PAD, np.full(7, 0.5), np.random.default_rng(0), 12)
    np.savez(tmp_path / "presses.npz", readings=given.readings, forces=given.forces)
    out, picture = tmp_path / "fitted.toml", tmp_path / "fit.png"
    PadFitCommand(mine, tmp_path / "presses.npz", 1e3 * RADIUS, out, picture).run()
    said = capsys.readouterr().out
    assert "90 % intervals" in said
    assert picture.stat().st_size > 10_000
    before, after = PAD.response.ranges(), read_pad(out).response.ranges()
    for name in ("stiffness", "law"):
        assert after[name][1] / after[name][0] < 0.5 * before[name][1] / before[name][0]
