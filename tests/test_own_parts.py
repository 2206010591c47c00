"""A user's own decider, scene and renderer run from the command line; the package is not touched."""

import json
import re
import runpy
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from experiments.cli import main

ROOT = Path(__file__).parent.parent
pytestmark = [pytest.mark.mujoco, pytest.mark.torch, pytest.mark.slow]


@pytest.fixture
def activetouch(tmp_path, monkeypatch, capfd):
    """Runs a command in a folder that holds nothing but one of the examples; returns what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    used = []

    def run(example, *words):
        if not (tmp_path / f"{example}.py").exists():
            shutil.copy(ROOT / "examples" / f"{example}.py", tmp_path)
        used.append(example)
        monkeypatch.setattr(sys, "argv", ["activetouch", *words])
        main()
        return capfd.readouterr()

    yield run
    for example in used:
        sys.modules.pop(example, None)


def episodes(folder):
    return [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]


SHORT = ("--fidelity", "quasistatic", "--targets", "cube", "--episodes", "1", "--jobs", "1", "--out", "run")


@pytest.mark.nightly  # the files of the page do the same
def test_the_example_of_a_decider_is_compared_by_its_name_with_settings(activetouch, tmp_path):
    name = "own_decider:EveryPose(poses=2, confirm=0.99)"
    activetouch("own_decider", "compare", "--scene", "coarse", "--deciders", name, "random_confirm", *SHORT)
    found = episodes(tmp_path / "run")
    assert [line["decider"] for line in found] == [name, "random_confirm"]
    assert found[0]["steps"][0]["action"] != found[1]["steps"][0]["action"]  # it probes, the other does not
    assert name in (tmp_path / "run" / "report.html").read_text()


@pytest.mark.nightly  # the files of the page do the same
def test_the_example_of_a_scene_is_touched_and_compared_with_a_sensor_of_another(activetouch, few_hypotheses, tmp_path):
    scene = "own_scene:pressed_harder(force=2.5)"
    activetouch("own_scene", "touch", "--scene", scene, "--shape", "cube", "--out", "cube.png")
    assert (tmp_path / "cube.png").stat().st_size > 0
    told = activetouch(
        "own_scene", "compare", "--scene", scene, "--sensor", "gel", "--deciders", "random_confirm", *SHORT
    )
    assert "made for another scene" not in told.err  # its reader of any object is told of the forces
    assert len(episodes(tmp_path / "run")[0]["arrangement"]) == 3


@pytest.mark.nightly  # a renderer of one's own has a test of its contract
def test_the_example_of_a_renderer_is_touched_and_compared(activetouch, tmp_path):
    renderer = "own_renderer:Outline(threshold=0.2)"
    activetouch("own_renderer", "touch", "--renderer", renderer, "--shape", "cube", "--out", "cube.png")
    assert (tmp_path / "cube.png").stat().st_size > 0
    told = activetouch(
        *("own_renderer", "compare", "--renderer", renderer, "--sensor", "gel", "--anyway"),
        *("--deciders", "fixed_poses(max_touches=1)", *SHORT),
    )
    assert "renderer is own_renderer.Outline" in told.err
    assert len(episodes(tmp_path / "run")) == 1


PAGE = (ROOT / "docs" / "extending.md").read_text()
FILES = dict(re.findall(r"^```python\n# (\w+)\.py\n(.*?)^```", PAGE, flags=re.M | re.S))
COMMANDS = re.findall(r"^((?:activetouch|python) .*\bmy_.*)$", PAGE, flags=re.M)
FEW = ("--fidelity", "quasistatic", "--episodes", "1", "--jobs", "1")
FEWER = {
    "my_decider compare": (*FEW, "--targets", "cube"),
    "my_scene compare": (*FEW, "--targets", "brick", "--deciders", "random_confirm"),
    "my_scene explain": ("--presses", "1"),
}


@pytest.mark.parametrize("command", [line for line in COMMANDS if line != "python my_model.py"])  # test_readme runs it
def test_a_file_of_the_page_runs_by_the_commands_of_the_page(command, activetouch, few_hypotheses, tmp_path, capfd):
    [name] = set(re.findall(r"\bmy_\w+", command))
    (tmp_path / f"{name}.py").write_text(FILES[name])
    program, *words = shlex.split(command)
    if program == "python":
        runpy.run_path(words[0], run_name="__main__")
        assert "keeps the contract" in capfd.readouterr().out
    else:
        told = activetouch(name, *words, *FEWER.get(f"{name} {words[0]}", ())).out
        assert {"compare": "report.html", "explain": "ball, brick, hat", "touch": "wrote brick.png"}[words[0]] in told


def test_the_page_has_a_file_for_a_decider_a_scene_and_a_model_and_runs_each():
    assert list(FILES) == ["my_decider", "my_scene", "my_model"]
    assert all(any(name in command for command in COMMANDS) for name in FILES)


@pytest.mark.parametrize("example", ["own_decider", "own_renderer"])
def test_the_examples_check_the_contract_that_they_keep(example):
    runpy.run_path(str(ROOT / "examples" / f"{example}.py"), run_name="__main__")
