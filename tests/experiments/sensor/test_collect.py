"""A collection is recorded once, whatever happens meanwhile, and can be made again byte for byte."""

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from activetouch.data.dataset import object_rng, read_split
from activetouch.data.images import WINDOWS, window_images
from activetouch.data.manifest import read_manifest
from activetouch.errors import LabelMismatch
from activetouch.named_scenes import SCENES
from belief.errors import CorruptFile
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import Collect, PlanArguments, collect, collect_images

pytestmark = pytest.mark.mujoco
PLAN = PlanArguments(train=13, calibration=1, test=1)
COARSE = SceneChoice("coarse")


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    folder = tmp_path_factory.mktemp("original")
    Collect(COARSE, out=folder, plan=PLAN, jobs=1).run()
    return folder


@pytest.fixture
def folder(original, tmp_path):
    return Path(shutil.copytree(original, tmp_path / "copy"))


def contents(folder):
    """Bytes of every file, by its path in the folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_manifest_says_how_the_scene_was_chosen(original):
    manifest = read_manifest(original)
    assert len(contents(original)) == 4 + 1
    assert manifest.choice == COARSE.to_dict()
    assert manifest.versions["numpy"] == np.__version__


@pytest.mark.parametrize("left", ["train/.00000.npz.abc.npz", ".manifest.json.abc.json"])
def test_what_a_killed_run_was_writing_is_removed(folder, left, original):
    (folder / left).write_bytes(b"half a file")
    collect(COARSE, PLAN.plan, folder, jobs=1)
    assert contents(folder) == contents(original)


KILLED = """
from pathlib import Path
from experiments.sensor.collect import Collect, PlanArguments, SceneChoice
if __name__ == "__main__":
    Collect(SceneChoice("coarse", fidelity="quasistatic"), Path({out!r}), PlanArguments(40, 1, 1), jobs=2).run()
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="kills a group of processes, which only POSIX has")
def test_a_killed_run_goes_on_to_the_bytes_of_one_that_was_not(tmp_path):
    choice, plan = SceneChoice("coarse", fidelity="quasistatic"), PlanArguments(40, 1, 1)
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    program = [sys.executable, "-c", KILLED.format(out=str(killed))]
    (shared := tmp_path / "shared").mkdir()  # for what joblib's cleaner, which is killed too, would remove
    own = {**os.environ, "JOBLIB_TEMP_FOLDER": str(shared)}
    with subprocess.Popen(program, start_new_session=True, stdout=subprocess.DEVNULL, env=own) as process:
        while not list(killed.glob("train/0*.npz")):
            assert process.poll() is None, "the run ended before it could be killed"
            time.sleep(0.002)
        os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    finished = {path: path.stat().st_mtime_ns for path in killed.glob("*/0*.npz")}
    assert 0 < len(finished) < 5
    Collect(choice, killed, plan, jobs=1).run()
    Collect(choice, whole, plan, jobs=1).run()
    assert contents(killed) == contents(whole)
    assert {path: path.stat().st_mtime_ns for path in finished} == finished  # not recorded a second time


def test_a_lost_shard_is_recorded_again_as_it_was(folder, original):
    (folder / "calibration" / "00000.npz").unlink()
    collect(COARSE, PLAN, folder, jobs=1)
    assert contents(folder) == contents(original)


def test_a_damaged_shard_is_found_when_the_command_is_run_again(folder):
    path = folder / "test" / "00000.npz"
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(CorruptFile, match=r"test/00000\.npz is truncated or damaged"):
        collect(COARSE, PLAN, folder, jobs=1)


def test_images_in_class_folders_are_windows_over_presses_split_by_object(tmp_path):
    choice, plan = SceneChoice("paper", presentation="resampled"), PlanArguments(train=2, calibration=0, test=1)
    Collect(choice, images=tmp_path / "images", plan=plan, jobs=1).run()
    folders = sorted(path.relative_to(tmp_path / "images").as_posix() for path in (tmp_path / "images").glob("*/*"))
    assert folders == [
        f"{split}/{shape}" for split in ("test", "train") for shape in sorted(SCENES["paper"].scene.shapes)
    ]
    files = contents(tmp_path / "images")
    assert len(set(files.values())) > 0.9 * len(files)  # few windows look the same
    objects = {name.rpartition("-")[0] for name in files if name.startswith("train/cube/")}
    assert objects == {"train/cube/000001", "train/cube/000005"}
    with Image.open(tmp_path / "images/train/cube/000001-003.png") as image:
        assert (image.mode, image.size) == ("RGB", (128, 128))
        written = np.asarray(image)
    scene, rng = choice.named.scene, object_rng(plan.plan, "train", 1)
    pressed = scene.press(scene.sample_object(1, rng), 0, rng)
    assert np.array_equal(window_images(scene, pressed.contact, WINDOWS, rng)[3], written)

    for name in ("train/cube/000001-000.png", "test/cone/000003-001.png"):  # the first is written last
        (tmp_path / "images" / name).unlink()
    (tmp_path / "images/train/cube/.000005-000.png.abc.png").write_bytes(b"half a file")
    Collect(choice, images=tmp_path / "images", plan=plan, jobs=1).run()
    assert set(files) - set(contents(tmp_path / "images")) == {"test/cone/000003-001.png"}
    assert contents(tmp_path / "images").items() <= files.items()


def test_images_are_one_for_each_touch_where_nothing_moves_and_never_of_two_plans(tmp_path):
    plan = PlanArguments(train=1, calibration=1, test=0)
    choice = SceneChoice("coarse", fidelity="quasistatic")
    assert collect_images(choice, plan.plan, tmp_path, 1) == 2 * 4 * 6
    collect(choice, plan.plan, tmp_path / "shards", 1)
    touches = read_split(tmp_path / "shards", "train")
    for row in range(6):
        with Image.open(tmp_path / f"train/sphere/000000-{row:03d}.png") as image:
            assert np.array_equal(np.asarray(image), touches.images[row])
    with pytest.raises(LabelMismatch, match="other plan"):
        collect_images(choice, replace(plan.plan, seed=1), tmp_path, 1)
    with pytest.raises(BadArgument, match="--images and --out"):
        Collect(choice, out=tmp_path, images=tmp_path, plan=plan).run()
