"""Deciders, scenes and sensors of a user's own: by name, by entry point, and as objects from Python."""

import json
import subprocess
import sys
from dataclasses import dataclass, replace

import pytest

import activetouch
from activetouch import SCENES, TactileSensor
from activetouch.distributions import Uniform
from belief.errors import ActiveTouchError, CodeFailed, UnknownName
from belief.references import BadReference
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice, named_scene, renderer_named
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.search.replay import Replay
from planners import SequentialDecider, make_decider
from planners.probing import FixedOrder
from planners.stopping import PosteriorThresholds

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
    setting = Setting(SceneChoice("coarse"))
    return Compare(deciders, out=folder, jobs=1, setting=setting, **{"targets": ("sphere",), "episodes": 1, **how})


@pytest.mark.mujoco
@pytest.mark.torch
def test_python_and_the_command_line_play_the_same_and_a_comparison_prints_gives_records_and_is_saved(folder, tmp_path):
    names = ("fixed_poses(confirm=0.9)", "own_parts:Mine(touches=3)")
    command(tmp_path / "command", *names).run()
    fixed = SequentialDecider(PosteriorThresholds(confirm=0.9), FixedOrder())
    deciders = {names[0]: fixed, names[1]: "own_parts:Mine(touches=3)"}
    found = activetouch.compare("coarse", deciders, episodes=1, targets="sphere", jobs=1)
    assert found.deciders == list(names)
    assert "own_parts:Mine" in str(found)
    assert "1 live searches per decider and target" in repr(found)
    assert [row["decider"] for row in found.rows()] == [name for name in names for _ in ("sphere", "all")]
    assert any("no-touch baseline" in sentence for sentence in found.verdict())
    assert found.save(tmp_path / "python") == tmp_path / "python" / "report.html"
    for file in ("episodes.jsonl", "tables/results.csv"):
        assert (tmp_path / "python" / file).read_bytes() == (tmp_path / "command" / file).read_bytes()
    Replay(tmp_path / "python", names[0], "sphere", out=tmp_path / "x.png", trust=True).run()


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
    assert not list(tmp_path.glob("**/*.safetensors"))  # the sensor is not written to be read back
    with pytest.raises(ActiveTouchError, match="only that program can"):
        Replay(tmp_path, "random_confirm", "cone", out=tmp_path / "x.png").run()


SCRIPT = """
import activetouch
from belief import Confirm
from planners import Decision

class Mine:
    def decide(self, info, rng):
        return Decision(Confirm())

if __name__ == "__main__":
    found = activetouch.compare("coarse", {"mine": Mine()}, episodes=2, targets=["cone"], jobs=2)
    print([(row["decider"], row["target"], row["episodes"]) for row in found.rows()][0])
"""


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.slow
def test_a_decider_that_a_script_defines_plays_in_worker_processes(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "('mine', 'cone', 2)"


@pytest.mark.parametrize(
    ("deciders", "error", "words"),
    [
        ({"": "threshold"}, BadArgument, "empty name"),
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


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("threshold(high=0.9, hihg=1)", BadReference, "high, low"),
        ("information_gain(confirm=7)", ActiveTouchError, "confirm"),
        ("point_based(table=3)", BadReference, "table is no setting"),
        ("information_gain(confirm='x')", BadReference, "information_gain"),
        ("own_parts:not_a_decider", BadReference, "no decider"),
        ("own_parts:raises", CodeFailed, "RuntimeError"),
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
    from activetouch.sensor_files import MODELS, fitted_model

    return fitted_model(MODELS / "coarse").model.outcome_table()


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
