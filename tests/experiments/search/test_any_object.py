"""Searches among objects that no sensor was trained for: the command ``compare`` from end to end, with no training."""

import json
import re

import pytest
import tyro

from activetouch.errors import MeshWarning
from belief.errors import ActiveTouchError, InvalidArgument
from experiments.cli import commands
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.search.comparison import prepared
from experiments.search.play import Setting, identity_of
from experiments.search.run import RunFolder, RunMismatch

CUBE = """v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"""
PLATE = CUBE.replace("v -1 -1 ", "v -1.5 -1.5 ").replace("v 1 -1 ", "v 1.5 -1.5 ")

pytestmark = pytest.mark.filterwarnings("ignore::activetouch.errors.AlikeShapes")


@pytest.fixture
def meshes(few_hypotheses, tmp_path, monkeypatch):
    """Two meshes as arguments of a command, and an empty cache."""
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "cache"))
    (tmp_path / "brick.obj").write_text(CUBE)
    (tmp_path / "plate.obj").write_text(PLATE)
    return [f"{tmp_path / name}.obj@0.011" for name in ("brick", "plate")]


def command(name, words):
    tyro.cli(commands()[name], args=words).run()


def test_compare_searches_for_a_mesh_without_training(meshes, tmp_path, capsys):
    (tmp_path / "plate.step").write_text("")
    folder = f"{tmp_path}@0.011"
    words = ["--scene", "coarse", "--fidelity", "quasistatic", "--only", "--meshes", folder, "--targets", "brick"]
    out = tmp_path / "run"
    run = [*words, "--deciders", "threshold", "--episodes", "2", "--jobs", "1", "--out", str(out)]
    with pytest.warns(MeshWarning) as warned:
        command("compare", run)
    episodes = [json.loads(line) for line in (out / "episodes.jsonl").read_text().splitlines()]
    assert len(episodes) == 2
    said = capsys.readouterr()
    assert "other scene" not in said.err
    assert "preparing the sensor" in said.err
    assert said.out.count("predicting contacts") == 1
    line = f"{tmp_path}/plate.step is left out: "
    assert line in str(warned[0].message)
    assert f"\n{line}" in said.out
    assert f"<p>{line}" in (out / "report.html").read_text()


def test_one_shape_is_refused_before_anything_is_prepared(meshes):
    for words in (["compare", "--jobs", "1"], ["live", "--target", "brick"]):
        with pytest.raises(InvalidArgument, match="one shape: nothing to tell apart"):
            command(words[0], [*words[1:], "--only", "--meshes", meshes[0]])


def test_a_target_with_the_name_of_all_targets_is_refused_before_anything_is_prepared(meshes):
    named = Setting(SceneChoice(meshes=(f"all={meshes[0]}", meshes[1]), only=True))
    with pytest.raises(BadArgument, match="a target cannot be called 'all', which stands for all of them"):
        prepared(named, "threshold", jobs=1)


def test_a_folder_of_another_run_is_refused_before_the_sensor_is_prepared(meshes, tmp_path, monkeypatch):
    setting = Setting(SceneChoice("coarse", "quasistatic"))
    RunFolder(tmp_path / "run").start(identity_of(setting.scene, setting.problem, 0), {})
    monkeypatch.setattr(Setting, "open_sensor", lambda *given: pytest.fail("it was prepared"))
    other = Setting(SceneChoice("coarse", "quasistatic", meshes=tuple(meshes), only=True))
    with pytest.raises(RunMismatch, match="other scene"):
        prepared(other, "threshold", jobs=1, out=tmp_path / "run")


def test_what_several_processes_need_is_computed_once_before(meshes, monkeypatch):
    setting = Setting(SceneChoice("coarse", "quasistatic", meshes=tuple(meshes), only=True))
    sensor = prepared(setting, "threshold", jobs=1).searches.sensor

    def computed(*given):
        raise AssertionError("it was in no cache")

    monkeypatch.setattr(type(sensor.reader.hypotheses), "embed", computed)
    assert prepared(setting, "threshold", jobs=1).searches.sensor.model.shape_labels == ("brick", "plate")


@pytest.mark.parametrize(
    ("scene", "advice"),
    [
        ("many", "Add --sensor gel"),
        ("paper", "Make one with the commands collect"),
        ("keyed", "Add --sensor gel"),
    ],
)
def test_a_scene_whose_sensor_reads_its_own_shapes_alone_says_what_to_do(scene, advice, meshes):
    with pytest.raises(ActiveTouchError, match=advice) as found:
        Setting(SceneChoice(scene, meshes=(meshes[0],))).open_sensor()
    assert re.search(r"the reader knows the shapes .*'brick'", str(found.value))
