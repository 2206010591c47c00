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


@pytest.mark.parametrize("words", [("-m", "activetouch", "compare"), ("-c", "import activetouch; activetouch.compare")])
def test_what_needs_a_hidden_package_names_the_folder(folder, words):
    done = run(folder, *words)
    assert done.returncode == 1
    assert f"{folder / 'planners'} hides the package 'planners'" in done.stderr
    assert "rename it" in done.stderr


@pytest.mark.parametrize("code", ["import activetouch", "from planners import search"])
def test_an_own_file_belief_is_named_at_import(tmp_path, code):
    (tmp_path / "belief.py").write_text("")
    done = run(tmp_path, "-c", code)
    assert f"{tmp_path / 'belief.py'} hides the package 'belief'" in done.stderr


def test_own_parts_are_found_beside_own_folders_that_have_names_of_packages(folder):
    (folder / "mine.py").write_text("x = 1")
    code = f"import sys; sys.path[:] = [{str(ROOT)!r}, *sys.path[1:]]; from belief.references import Reference\n"
    done = run(
        folder, "-c", code + "print(Reference.parse('mine:x').load()); import planners; print(planners.__file__)"
    )
    assert done.stdout.split() == ["1", str(ROOT / "planners" / "__init__.py")]


def test_an_own_file_with_the_name_of_an_installed_module_is_refused(tmp_path):
    (tmp_path / "numpy.py").write_text("x = 1")
    code = f"import sys; sys.path[:] = [{str(ROOT)!r}, *sys.path[1:]]; from belief.references import Reference\n"
    done = run(tmp_path, "-c", code + "Reference.parse('numpy:x').load()")
    assert f"{tmp_path / 'numpy.py'} is hidden by" in done.stderr
