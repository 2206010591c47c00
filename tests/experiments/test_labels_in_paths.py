"""A label, whatever its characters, is one part of a file name; nothing is written outside of the given folder."""

from pathlib import Path

import pytest

from experiments.scene_choice import SceneChoice, collection_folder, in_file_names
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.search.run import _file_name
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
