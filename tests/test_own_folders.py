"""A user's own folders called ``planners/`` or ``experiments/`` are detected and named."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def run(folder, *words):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.run([sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True)


@pytest.fixture
def folder(tmp_path):
    for name in ("planners", "experiments"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise SystemExit('the wrong package')")
    return tmp_path


@pytest.mark.mujoco
def test_the_command_runs_beside_own_folders_and_names_them(folder):
    short = ("--scene", "coarse", "--fidelity", "quasistatic", "--episodes", "1", "--deciders", "threshold")
    short += ("--targets", "cone", "--jobs", "2")
    done = run(folder, "-m", "activetouch", "compare", *short)
    assert done.returncode == 0, done.stderr
    assert f"{folder / 'planners'} and {folder / 'experiments'}: not used" in done.stderr
    assert (folder / "runs" / "compare-coarse" / "report.html").exists()


def test_functions_that_need_a_hidden_package_name_the_folder(folder):
    done = run(folder, "-c", "import activetouch; activetouch.compare")
    assert f"{folder / 'planners'} hides the package 'planners'" in done.stderr
    assert "rename it" in done.stderr


def test_an_own_folder_belief_is_named_at_import(tmp_path):
    (tmp_path / "belief.py").write_text("")
    done = run(tmp_path, "-c", "import activetouch")
    assert f"{tmp_path / 'belief.py'} hides the package 'belief'" in done.stderr


def test_own_parts_beside_own_folders_are_refused_with_the_folder(folder):
    (folder / "mine.py").write_text("x = 1")
    code = f"import sys; sys.path[:] = [{str(ROOT)!r}, *sys.path[1:]]; from belief.references import Reference\n"
    done = run(folder, "-c", code + "Reference.parse('mine:x').load()")
    assert "BadReference" in done.stderr
    assert f"{folder / 'experiments'} has the name of a package of activetouch" in done.stderr
