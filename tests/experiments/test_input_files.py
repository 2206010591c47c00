"""A pipe, a device or a folder in place of a file to read is refused; opening a pipe would wait for ever."""

import os
import shutil

import pytest

from activetouch.data.manifest import read_manifest
from activetouch.envs.touch_bank import TouchBank
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import MODELS, fitted_model
from belief.errors import ActiveTouchError
from belief.sealed_tensors import read_fields
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.search.replay import Replay
from experiments.search.run import RunFolder
from planners.fingerprint import files_digest
from planners.other_agents import _model

pytestmark = [pytest.mark.torch, pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="makes a pipe")]


def compare_with_sensor(path):
    Compare(setting=Setting(SceneChoice("coarse"), sensor=path.parent), out=path.parent / "out", jobs=1).play()


READERS = {
    "a reader": ("reader.safetensors", TactileReader.load),
    "fields of tensors": ("state.safetensors", read_fields),
    "an observation model": ("observation_model.json", lambda path: fitted_model(path.parent)),
    "--config": ("run.json", Compare.from_config),
    "--config of a folder": ("run.json", lambda path: Compare.from_config(path.parent)),
    "a run": ("run.json", lambda path: RunFolder(path.parent).read_run()),
    "replay": ("run.json", lambda path: Replay(path.parent, out=path.parent / "out.png").run()),
    "a collection": ("manifest.json", lambda path: read_manifest(path.parent)),
    "a touch bank": ("manifest.json", lambda path: TouchBank.open(path.parent)),
    "a policy of SB3": ("model.zip", lambda path: _model(path, (0, 0))),
    "a digest": ("any", lambda path: files_digest([path])),
    "--sensor, the reader": ("reader.safetensors", compare_with_sensor),
    "--sensor, the model": ("observation_model.json", compare_with_sensor),
}


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_or_a_device_is_no_file_to_read(name, tmp_path):
    file, read = READERS[name]
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    if name.startswith("--sensor"):
        shutil.copytree(MODELS / "coarse", tmp_path, dirs_exist_ok=True)
        path.unlink()
    for kind, make in (("pipe", os.mkfifo), ("device", lambda path: os.symlink("/dev/zero", path))):
        make(path)
        refused = f"is a {kind}, not a regular file|there is no {path.name} in it"
        with pytest.raises(ActiveTouchError, match=refused):
            read(path)
        path.unlink()


def test_a_cell_that_is_a_pipe_is_refused(tmp_path):
    (tmp_path / "cells").mkdir()
    os.mkfifo(tmp_path / "cells" / "threshold-cone.jsonl")
    with pytest.raises(ActiveTouchError, match="is a pipe"):
        RunFolder(tmp_path).batches(("threshold", "cone"))
