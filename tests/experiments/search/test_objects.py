"""Deciders, scenes and sensors of a user's own: by name, by entry point, and as objects from Python."""

import json
import pickle
import subprocess
import sys
from dataclasses import dataclass, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

import activetouch
from activetouch import SCENES, TactileSensor
from activetouch.distributions import Uniform
from activetouch.poses import POSE_SETS
from belief.errors import ActiveTouchError, UnknownName
from belief.references import BadReference
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice, named_scene, renderer_named
from experiments.search.compare import Compare
from experiments.search.objects import SceneObject, _sensor_folder
from experiments.search.run_folder import ShardKey
from experiments.search.setting import Setting
from planners import SequentialDecider, make_decider
from planners.probing import FixedOrder
from planners.stopping import PosteriorThresholds

needs_world = [pytest.mark.mujoco, pytest.mark.torch]
MINE = """
from dataclasses import dataclass

from belief import Confirm, Probe, Reject
from planners import Decision


@dataclass(frozen=True)
class Mine:
    touches: int = 2

    def decide(self, info, rng):
        if len(info.history) < self.touches:
            return Decision(Probe(len(info.history)))
        return Decision(Confirm() if info.target_prob > 0.9 else Reject())


def with_all(table, model, policies, **rest):
    assert not rest
    return Mine(int(table is not None) + int(model is not None))


def raises():
    raise RuntimeError("no")


not_a_decider = 3
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, in which there is a module of a user's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def write(text):
        (tmp_path / "own_parts.py").write_text(text)
        sys.modules.pop("own_parts", None)

    write(MINE)
    yield write
    sys.modules.pop("own_parts", None)


def command(folder, *deciders, **how):
    return Compare(
        deciders,
        targets=("sphere",),
        out=folder,
        jobs=1,
        setting=Setting(SceneChoice("coarse")),
        **{"episodes": 1, **how},
    )


@pytest.mark.mujoco
@pytest.mark.torch
def test_an_edited_module_of_a_user_gives_the_new_numbers_in_the_same_folder(folder, tmp_path, capsys):
    def touches(text, out):
        folder(text)
        cells = command(tmp_path / out, "own_parts:Mine", "random_confirm").play().cells
        return cells["own_parts:Mine", "all"].touches

    edited = MINE.replace("touches: int = 2", "touches: int = 5")
    before = touches(MINE, "run")
    capsys.readouterr()
    after = touches(edited, "run")
    assert "1 of own_parts:Mine" in capsys.readouterr().err
    assert before < after == touches(edited, "fresh")


@pytest.mark.mujoco
@pytest.mark.torch
def test_python_and_the_command_line_play_the_same_episodes(folder, tmp_path):
    names = ("fixed_poses(confirm=0.9)", "own_parts:Mine(touches=3)")
    command(tmp_path / "command", *names).run()
    fixed = SequentialDecider(PosteriorThresholds(confirm=0.9), FixedOrder())
    deciders = {names[0]: fixed, names[1]: "own_parts:Mine(touches=3)"}
    found = activetouch.compare("coarse", deciders, episodes=1, targets=["sphere"], out=tmp_path / "python", jobs=2)
    assert found.deciders == list(names)
    for file in ("episodes.jsonl", "tables/returns.csv"):
        assert (tmp_path / "python" / file).read_bytes() == (tmp_path / "command" / file).read_bytes()
    assert (tmp_path / "python" / "report.html").exists()


@pytest.mark.mujoco
@pytest.mark.torch
def test_a_scene_and_a_sensor_that_a_program_made_are_compared_in(tmp_path):
    gel = SCENES["coarse"]
    shifted = replace(gel.scene, variation=replace(gel.scene.variation, force=Uniform(2.0, 4.0)))
    found = activetouch.compare(
        replace(gel, scene=shifted, num_objects=2),
        ["random_confirm"],
        episodes=1,
        targets=["cone"],
        sensor=TactileSensor.shipped("coarse"),
        out=tmp_path,
        jobs=1,
    )
    assert found.cells["random_confirm", "all"].num_episodes == 1
    line = json.loads((tmp_path / "episodes.jsonl").read_text().splitlines()[0])
    assert len(line["arrangement"]) == 2


SCRIPT = """
import activetouch
from belief import Confirm
from planners import Decision

class Mine:
    def decide(self, info, rng):
        return Decision(Confirm())

if __name__ == "__main__":
    activetouch.compare("coarse", {"mine": Mine()}, episodes=2, targets=["cone"], out="run", jobs=2)
"""


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.slow
def test_a_decider_that_a_script_defines_plays_in_worker_processes(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    subprocess.run([sys.executable, "script.py"], cwd=tmp_path, check=True, capture_output=True)
    assert len((tmp_path / "run" / "episodes.jsonl").read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("deciders", "error", "words"),
    [
        ({"oracle": "threshold"}, BadArgument, "another name"),
        ({"mine": 3}, BadArgument, "no method decide"),
        (["thresold"], UnknownName, "threshold"),
        ([], BadArgument, "got none"),
    ],
)
def test_what_is_no_decider_is_refused_before_anything_is_written(deciders, error, words, tmp_path):
    with pytest.raises(error, match=words):
        activetouch.compare("coarse", deciders, episodes=1, out=tmp_path / "run", jobs=1)
    assert not (tmp_path / "run").exists()


def test_what_is_no_scene_is_refused(tmp_path):
    with pytest.raises(BadArgument, match="Scene"):
        activetouch.compare(3, ["threshold"], out=tmp_path / "run")


def test_scenes_that_differ_are_different_settings():
    one, other = SCENES["gel"], replace(SCENES["gel"], num_objects=3)
    assert SceneObject.of(one) == SceneObject.of(replace(one))
    assert SceneObject.of(one) != SceneObject.of(other)
    assert hash(Setting(SceneObject.of(one))) == hash(Setting(SceneObject.of(replace(one))))
    assert pickle.loads(pickle.dumps(SceneObject.of(other))).named.num_objects == 3


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("threshold(high=0.9, hihg=1)", BadReference, "high, low"),
        ("information_gain(confirm=7)", ActiveTouchError, "confirm"),
        ("point_based(table=3)", BadReference, "table is no setting"),
        ("information_gain(confirm='x')", BadReference, "information_gain"),
        ("own_parts:not_a_decider", BadReference, "no decider"),
        ("own_parts:raises", BadReference, "RuntimeError"),
        ("own_parts:Min", UnknownName, "Mine"),
        ("own_part:Mine", BadReference, "own_part.py"),
        ("nobody", UnknownName, "Known"),
    ],
)
def test_a_name_that_leads_to_no_decider_says_why(name, error, words, coarse_table):
    with pytest.raises(error, match=words):
        make_decider(name, coarse_table)


@pytest.fixture(scope="module")
def coarse_table():
    from activetouch.sensor_files import MODELS, load_observation_model

    return load_observation_model(MODELS / "coarse").outcome_table()


@pytest.mark.usefixtures("folder")
def test_a_builder_gets_what_it_asks_for_by_name(coarse_table):
    assert make_decider("own_parts:with_all", coarse_table).touches == 1
    assert make_decider("pouct(simulations=50)", coarse_table).simulations == 50
    assert make_decider("pouct", coarse_table, simulations=60).simulations == 60
    assert make_decider("pouct(simulations=50)", coarse_table, simulations=60).simulations == 50
    assert make_decider("value_of_information(depth=1)", coarse_table).depth == 1


@dataclass(frozen=True)
class Entry:
    """An entry point of an installed package."""

    name: str
    value: str


@pytest.mark.usefixtures("folder")
def test_an_installed_package_offers_parts_by_entry_points(monkeypatch, coarse_table):
    offered = {
        "activetouch.deciders": [Entry("offered", "own_parts:Mine")],
        "activetouch.scenes": [Entry("offered", "activetouch.named_scenes:NamedScene")],
        "activetouch.renderers": [Entry("offered", "activetouch.rendering:PressureRenderer")],
    }
    monkeypatch.setattr("belief.references.entry_points", lambda group: offered.get(group, []))
    assert make_decider("offered(touches=7)", coarse_table).touches == 7
    assert named_scene("offered(num_objects=2)").num_objects == 2
    assert renderer_named("offered(binning=4)").binning == 4
    assert SceneChoice("offered", renderer="offered").named.scene.image_shape == (128, 128)
    with pytest.raises(UnknownName, match="offered"):
        make_decider("offred", coarse_table)


@given(*[st.text(min_size=1, max_size=20)] * 2, st.integers(0, 10**6))
def test_every_key_has_a_file_name_of_its_own(decider, target, number):
    key = ShardKey(decider, target, number)
    assert ShardKey.from_stem(key.stem) == key
    assert set(key.stem) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_%-")


def test_plain_names_stand_in_file_names_as_they_are():
    assert ShardKey("point_based", "my-mug", 3).stem == "point_based-my-mug-00003"


def test_a_sensor_object_is_of_the_poses_of_its_scene(tmp_path):
    sensor = TactileSensor.shipped("coarse")
    poses = dict(list(POSE_SETS["directions26"].items())[: len(sensor.scene.poses)])
    scene = replace(sensor.scene, poses=poses)
    folder = _sensor_folder(TactileSensor(scene, sensor.reader, sensor.model), tmp_path)
    assert TactileSensor.load(folder, scene).shift == ()


def test_a_second_sensor_object_leaves_that_of_the_run_as_it_was(tmp_path):
    folders = [_sensor_folder(TactileSensor.shipped(name), tmp_path) for name in ("coarse", "gel", "coarse")]
    assert folders[0] == folders[2] != folders[1]
    assert sorted(tmp_path.iterdir()) == sorted({*folders})


@pytest.mark.mujoco
def test_one_decider_and_one_target_need_no_list(tmp_path):
    found = activetouch.compare("coarse", "random_confirm", targets="cone", episodes=1, out=tmp_path, jobs=1)
    assert (found.deciders, found.targets) == (["random_confirm"], ["cone"])
