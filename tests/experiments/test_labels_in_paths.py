"""A label, whatever its characters, is one part of a file name; nothing is written outside of the given folder."""

from dataclasses import replace
from pathlib import Path

import pytest

from activetouch import named_scenes
from experiments.press.touch import write_presses
from experiments.scene_choice import SceneChoice, collection_folder, in_file_names
from experiments.search.compare import Compare
from experiments.search.run_folder import _file_name
from experiments.search.setting import Setting
from planners.ppo import policy_file

LABELS = [
    "../escaped",
    "a/b",
    "a%2Fb",
    "..",
    "/etc/x",
    "a\\b",
    "c:x",
    "hex nut",
    "hex-nut",
    "ä",
    "\0",
    "a\nb",
    "cube",
    "Cube.",
]
NAMES = {
    "policies": lambda label: policy_file("paper", label),
    "deciders of cells": lambda label: _file_name((label, "cone")),
    "targets of cells": lambda label: _file_name(("threshold", label)),
    "folders of scenes": lambda label: collection_folder(label).name,
    "folders of runs": lambda label: Compare(setting=Setting(SceneChoice(label)), jobs=1).folder.name,
}


@pytest.mark.parametrize("kind", NAMES)
def test_a_label_becomes_one_part_of_a_path(kind):
    for label in LABELS:
        name = NAMES[kind](label)
        assert not {"/", "\\", ":", "\0", "\n"} & set(name)
        assert name not in {".", ".."}
        assert len(Path("folder", name).parts) == 2 or kind == "folders of scenes"
    if not kind.startswith("folders"):  # of which the content says what it is of
        assert len({NAMES[kind](label) for label in LABELS}) == len(LABELS)
    assert in_file_names("..") == ""


@pytest.mark.mujoco
def test_recordings_of_a_shape_with_a_path_as_its_label_stay_in_the_folder(tmp_path):
    named = named_scenes.SCENES["paper"]
    cube = named.scene.shapes["cube"]
    scene = replace(named.scene, shapes=dict.fromkeys(LABELS, cube))
    (tmp_path / "out").mkdir()
    write_presses(scene, 0, tmp_path / "out", num_cycles=1)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert len(list((tmp_path / "out").glob("*.csv"))) == len(LABELS)
    assert (tmp_path / "out" / "cube.csv").exists()
