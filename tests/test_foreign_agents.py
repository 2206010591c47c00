"""Agents of other libraries, with no line of this package inside, are compared as their users would do it."""

import csv
import re
import runpy
import shutil
import sys
from pathlib import Path

import pytest

from experiments.cli import main

FOLDER = Path(__file__).parent.parent / "examples" / "foreign"


@pytest.fixture
def run(tmp_path, monkeypatch, few_hypotheses):
    """Runs a script or a command in a folder that holds the examples alone."""
    shutil.copytree(FOLDER, tmp_path, dirs_exist_ok=True)
    for name, of_users, few in (
        ("sb3_ppo.py", "n_steps=256, batch_size=128", "n_steps=32, batch_size=32"),
        ("pomdp_py_agent.py", "num_sims=300", "num_sims=20"),
        ("recurrent_ppo.py", "n_steps=128, batch_size=128", "n_steps=16, batch_size=16"),
    ):
        text = (tmp_path / name).read_text()
        assert of_users in text
        (tmp_path / name).write_text(text.replace(of_users, few))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])  # to which commands add the folder
    for name in ("pomdp_py_agent", "cleanrl_ppo"):
        monkeypatch.delitem(sys.modules, name, raising=False)

    def run(name, *words):
        monkeypatch.setattr(sys, "argv", [name, *words])
        return main() if name == "activetouch" else runpy.run_path(name, run_name="__main__")

    return run


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.name)
def test_nothing_of_this_package_is_in_them(path):
    assert not re.search(r"^\s*(import|from) (activetouch|belief|planners|experiments)", path.read_text(), flags=re.M)


@pytest.mark.torch
@pytest.mark.mujoco
def test_ppo_and_an_agent_of_pomdp_py_play_the_same_searches(run, capsys):
    pytest.importorskip("pomdp_py")
    run("sb3_ppo.py", "1")
    words = ("--scene", "coarse", "--targets", "cone", "--episodes", "2", "--jobs", "1", "--out", "run")
    deciders = ("sb3:cone.zip(normalize='cone.pkl')", "policy:pomdp_py_agent:Agent(remembers=True,sees_target=True)")
    run("activetouch", "compare", *words, "--deciders", *deciders, "random_confirm")
    assert "2 live searches per decider" in " ".join(capsys.readouterr().out.split())
    assert Path("run/report.html").exists()


@pytest.mark.nightly
@pytest.mark.torch
@pytest.mark.mujoco
def test_a_file_as_of_cleanrl_and_a_recurrent_policy_learn_and_play(run, capsys):
    words = ("--targets", "cone", "--episodes", "2", "--jobs", "1")
    run("cleanrl_ppo.py", "1")
    cleanrl, recurrent = "policy:cleanrl_ppo:act(state='posterior')", "sb3:recurrent.zip"
    scene = ("--scene", "paper", "--sensor", "paper-independent")
    run("activetouch", "compare", *scene, *words, "--out", "one", "--deciders", cleanrl)
    run("recurrent_ppo.py", "1")
    run("activetouch", "compare", "--scene", "coarse", *words, "--out", "two", "--deciders", recurrent)
    assert " ".join(capsys.readouterr().out.split()).count("2 live searches per decider") == 2


@pytest.mark.mujoco
def test_a_player_of_ap_gym_is_compared_by_its_results(run, capsys):
    pytest.importorskip("ap_gym")
    run("apgym_player.py", "8", "3")
    with open("in_turn.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["seed"], row["task"]) for row in rows] == [(str(seed), "coarse") for seed in range(3)]
    run("activetouch", "compare", "--results", "in_turn.csv", "at_random.csv")
    assert "3 episodes are in all files" in capsys.readouterr().out
