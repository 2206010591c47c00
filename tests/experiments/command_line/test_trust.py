"""No command runs code that only a file names; with --trust it does."""

import sys
from contextlib import suppress
from dataclasses import replace
from functools import partial

import pytest

from activetouch.data.manifest import CollectionPlan, Manifest
from activetouch.named_scenes import SCENES
from belief.errors import ActiveTouchError
from experiments.command_line.arguments import FileNamesCode, Trust
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.search.replay import Replay
from experiments.search.run import RunFolder
from experiments.sensor.calibrate import scene_of

CODE = "open('it_ran', 'w').close()\nfrom activetouch.named_scenes import SCENES\nscene = SCENES['coarse']\n"


def arguments(choice, decider="threshold", **others):
    """What a comparison records."""
    searches = {"deciders": [decider], "reference": None, "targets": [], "episodes": 1, "seed": 0}
    return {**searches, "setting": Setting(choice).to_dict(), **others}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder that holds a run and a collection, both of a scene that is code, and the module with the code."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "own_code.py").write_text(CODE)
    choice = SceneChoice("own_code:scene")
    RunFolder(tmp_path).start({}, arguments(choice))
    yield tmp_path
    sys.modules.pop("own_code", None)


def commands(folder, trust):
    manifest = Manifest.of(SCENES["coarse"].scene, CollectionPlan(1, 1, 1), SceneChoice("own_code:scene").to_dict())
    config = replace(Compare.from_config(folder), trust=trust)
    return {
        "replay": Replay(folder, trust=trust).run,
        "compare": config.run,
        "calibrate": partial(scene_of, manifest, Trust(folder, everything=trust)),
    }


@pytest.mark.parametrize("name", ["replay", "compare", "calibrate"])
def test_a_file_runs_no_code_unless_it_is_trusted(folder, name):
    with pytest.raises(FileNamesCode, match=r"names code: own_code:scene\..*add --trust"):
        commands(folder, trust=False)[name]()
    assert not (folder / "it_ran").exists()


@pytest.mark.parametrize("name", ["replay", "calibrate"])
def test_a_trusted_file_may_name_code(folder, name):
    with suppress(FileNotFoundError, ActiveTouchError):  # the folder holds no searches
        commands(folder, trust=True)[name]()
    assert (folder / "it_ran").exists()


def test_a_recorded_run_cannot_trust_itself(folder):
    RunFolder(folder).start({}, arguments(SceneChoice("own_code:scene"), trust=True))
    assert not Compare.from_config(folder).trust


@pytest.mark.parametrize("name", ["own_code:Decider(touches=3)", "sb3:model.zip"])
def test_a_decider_of_the_command_line_is_followed_and_one_of_the_file_is_not(tmp_path, name):
    RunFolder(tmp_path).start({}, arguments(SceneChoice("coarse"), name))
    asked = Compare.from_config(tmp_path)
    with pytest.raises(FileNamesCode, match="names code"):
        asked.run()
    assert Trust(tmp_path, known=(name,)).allows(name)
    assert Trust(tmp_path).allows("information_gain(given='a:b')")
